//! COLMAP's binary files: little-endian, without padding; each starts with its number of records.

use std::{collections::BTreeMap, path::Path};

use glam::{DQuat, DVec3, dvec2, dvec3};

use super::{
    CameraModel, ColmapCamera, ColmapImage, ColmapObservation, ColmapPoint, camera_model::unknown_model,
    model::NO_POINT,
};
use crate::error::Error;

/// Size of a camera's id, model and size.
const CAMERA_BYTES: usize = 4 + 4 + 8 + 8;
/// Size of an image without name and keypoints: id, pose, camera, end of the name, number of
/// keypoints.
const IMAGE_BYTES: usize = 4 + 7 * 8 + 4 + 1 + 8;
/// Bytes of a keypoint.
const OBSERVATION_BYTES: usize = 8 + 8 + 8;
/// Size of a point without a track: id, position, colour, error, length of the track.
const POINT_BYTES: usize = 8 + 3 * 8 + 3 + 8 + 8;
/// Size of a track element: image, keypoint.
const TRACK_BYTES: usize = 4 + 4;

/// `cameras.bin`.
pub(super) fn cameras(path: &Path, bytes: &[u8]) -> Result<BTreeMap<u32, ColmapCamera>, Error> {
    let mut reader = Reader { path, what: "a COLMAP cameras.bin", bytes, at: 0 };
    let count = reader.count("cameras", CAMERA_BYTES)?;
    let mut cameras = BTreeMap::new();
    for _ in 0..count {
        let (id, model) = (reader.u32()?, reader.u32()?);
        let model = CameraModel::from_id(model).ok_or_else(|| unknown_model(path, model))?;
        let (width, height) = (reader.u64()?, reader.u64()?);
        let parameters = model.parameter_names().iter().map(|_| reader.f64()).collect::<Result<_, _>>()?;
        cameras.insert(id, ColmapCamera { model, width, height, parameters });
    }
    reader.end()?;
    Ok(cameras)
}

/// `images.bin`.
pub(super) fn images(path: &Path, bytes: &[u8]) -> Result<Vec<ColmapImage>, Error> {
    let mut reader = Reader { path, what: "a COLMAP images.bin", bytes, at: 0 };
    let count = reader.count("images", IMAGE_BYTES)?;
    let mut images = Vec::with_capacity(count);
    for _ in 0..count {
        let id = reader.u32()?;
        let [w, x, y, z] = reader.f64s()?;
        let translation = DVec3::from_array(reader.f64s()?);
        let camera_id = reader.u32()?;
        let name = reader.name()?;
        let keypoints = reader.count("keypoints", OBSERVATION_BYTES)?;
        let mut observations = Vec::with_capacity(keypoints);
        for _ in 0..keypoints {
            let [x, y] = reader.f64s()?;
            let point = Some(reader.u64()?).filter(|point| *point != NO_POINT);
            observations.push(ColmapObservation { position: dvec2(x, y), point });
        }
        images.push(ColmapImage {
            id,
            rotation: DQuat::from_xyzw(x, y, z, w),
            translation,
            camera_id,
            name,
            observations,
        });
    }
    reader.end()?;
    Ok(images)
}

/// `points3D.bin`.
pub(super) fn points(path: &Path, bytes: &[u8]) -> Result<Vec<ColmapPoint>, Error> {
    let mut reader = Reader { path, what: "a COLMAP points3D.bin", bytes, at: 0 };
    let count = reader.count("points", POINT_BYTES)?;
    let mut points = Vec::with_capacity(count);
    for _ in 0..count {
        let id = reader.u64()?;
        let [x, y, z] = reader.f64s()?;
        let color = reader.take::<3>()?;
        let error = reader.f64()?;
        let track = reader.count("observations of a point", TRACK_BYTES)?;
        reader.at += track * TRACK_BYTES; // that many are there: `count` has seen to it
        points.push(ColmapPoint { id, position: dvec3(x, y, z), color, error });
    }
    reader.end()?;
    Ok(points)
}

/// A cursor in the bytes of a file.
struct Reader<'a> {
    path: &'a Path,
    what: &'static str,
    bytes: &'a [u8],
    at: usize,
}

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], Error> {
        let Some(taken) = self.bytes[self.at..].first_chunk::<N>() else {
            return Err(self.damaged(format!("{N} more bytes"), format!("the end of the file after {}", self.left())));
        };
        self.at += N;
        Ok(*taken)
    }

    fn u32(&mut self) -> Result<u32, Error> {
        self.take().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Result<u64, Error> {
        self.take().map(u64::from_le_bytes)
    }

    fn f64(&mut self) -> Result<f64, Error> {
        self.take().map(f64::from_le_bytes)
    }

    fn f64s<const N: usize>(&mut self) -> Result<[f64; N], Error> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64()?;
        }
        Ok(values)
    }

    /// Reads a number of records of at least `least` bytes each, and checks that the rest of the
    /// file has room for them.
    fn count(&mut self, records: &str, least: usize) -> Result<usize, Error> {
        let start = self.at;
        let count = self.u64()?;
        let room = self.left() / least;
        match usize::try_from(count) {
            Ok(count) if count <= room => Ok(count),
            _ => {
                self.at = start;
                Err(self.damaged(format!("at most {room} {records}, for which there is room"), format!("{count}")))
            }
        }
    }

    /// Reads a text that ends with a 0 byte; invalid UTF-8 becomes U+FFFD.
    fn name(&mut self) -> Result<String, Error> {
        let rest = &self.bytes[self.at..];
        let Some(length) = rest.iter().position(|byte| *byte == 0) else {
            return Err(
                self.damaged("a name that ends with a 0 byte".to_owned(), "none to the end of the file".to_owned())
            );
        };
        self.at += length + 1;
        Ok(String::from_utf8_lossy(&rest[..length]).into_owned())
    }

    fn end(&self) -> Result<(), Error> {
        match self.left() {
            0 => Ok(()),
            more => Err(self.damaged("the end of the file".to_owned(), format!("{more} more bytes"))),
        }
    }

    fn left(&self) -> usize {
        self.bytes.len() - self.at
    }

    fn damaged(&self, expected: String, found: String) -> Error {
        let place = format!("byte {}", self.at);
        Error::Damaged { path: self.path.to_owned(), what: self.what, place, expected, found }
    }
}
