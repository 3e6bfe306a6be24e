//! A sparse model as COLMAP writes it in binary, as far as it is judged and turned here.
//!
//! *Source:* COLMAP's documentation ("Output Format").

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use glam::{DMat3, DQuat, DVec3, dvec3};

use crate::error::Error;

/// The files of a model. That of the cameras comes last: where it is, a model is.
pub(crate) const FILES: [&str; 3] = ["points3D.bin", "images.bin", "cameras.bin"];

/// Parameters of COLMAP's models of cameras by their numbers, of which the first is a focal length.
const PARAMETERS: [usize; 11] = [3, 4, 4, 5, 8, 8, 12, 5, 4, 5, 12];

/// A model.
#[derive(Debug, Clone)]
pub(crate) struct Model {
    pub(crate) images: Vec<Registered>,
    /// The points' reprojection errors, px.
    pub(crate) errors: Vec<f64>,
    /// The files, and where poses and positions are in them.
    files: [Vec<u8>; 3],
    poses_at: Vec<usize>,
    points_at: Vec<usize>,
}

/// An image whose pose was found.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Registered {
    pub(crate) name: String,
    /// World to camera.
    pub(crate) rotation: DQuat,
    pub(crate) translation: DVec3,
    /// Number of its features that belong to points.
    pub(crate) observations: usize,
    /// The focal length (that along x) of its camera, as a share of the image's longer side.
    pub(crate) focal: f64,
}

/// The models in the numbered folders of `models`, the one with most images first.
pub(crate) fn models_in(models: &Path) -> Result<Vec<Model>, Error> {
    let folders = fs::read_dir(models).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut folders: Vec<PathBuf> = folders.filter(|folder| folder.join(FILES[2]).is_file()).collect();
    folders.sort();
    let mut found = folders.iter().map(|folder| Model::read(folder)).collect::<Result<Vec<_>, Error>>()?;
    found.retain(|model| !model.images.is_empty());
    found.sort_by_key(|model| std::cmp::Reverse((model.images.len(), model.errors.len())));
    Ok(found)
}

impl Model {
    pub(crate) fn read(folder: &Path) -> Result<Self, Error> {
        let read = |name: &str| {
            let path = folder.join(name);
            fs::read(&path).map_err(Error::at(path))
        };
        let files = [read(FILES[0])?, read(FILES[1])?, read(FILES[2])?];
        let damaged = |name: &str| Error::Model { path: folder.join(name), what: "it ends early" };
        let (errors, points_at) = points(&files[0]).ok_or_else(|| damaged(FILES[0]))?;
        let unknown =
            || Error::Model { path: folder.join(FILES[2]), what: "it ends early, or has an unknown kind of camera" };
        let focals = focals(&files[2]).ok_or_else(unknown)?;
        let (images, poses_at) = images(&files[1], &focals).ok_or_else(|| damaged(FILES[1]))?;
        Ok(Self { images, errors, files, poses_at, points_at })
    }

    /// Turns the world, and makes it so many times as large.
    pub(crate) fn turn(&mut self, rotation: DQuat, scale: f64) {
        let back = rotation.inverse();
        for (image, at) in self.images.iter_mut().zip(&self.poses_at) {
            image.rotation = (image.rotation * back).normalize();
            let DQuat { x, y, z, w } = image.rotation;
            image.translation *= scale;
            let [tx, ty, tz] = image.translation.to_array();
            put(&mut self.files[1], *at, &[w, x, y, z, tx, ty, tz]);
        }
        let matrix = DMat3::from_quat(rotation);
        for at in &self.points_at {
            let mut bytes = Bytes { rest: &self.files[0][*at..] };
            let Some([x, y, z]) = bytes.numbers() else { continue };
            let turned = matrix * dvec3(x, y, z) * scale;
            put(&mut self.files[0], *at, &turned.to_array());
        }
    }

    /// Writes the files for COLMAP.
    pub(crate) fn write(&self, folder: &Path) -> Result<(), Error> {
        self.files().try_for_each(|(name, bytes)| {
            let path = folder.join(name);
            fs::write(&path, bytes).map_err(Error::at(path))
        })
    }

    /// The files by name, in the order in which they are to be written.
    pub(crate) fn files(&self) -> impl Iterator<Item = (&'static str, &[u8])> {
        FILES.into_iter().zip(self.files.iter().map(Vec::as_slice))
    }
}

fn put(bytes: &mut [u8], at: usize, values: &[f64]) {
    for (value, place) in values.iter().zip(bytes[at..].chunks_exact_mut(8)) {
        place.copy_from_slice(&value.to_le_bytes());
    }
}

/// The focal lengths of the cameras in `cameras.bin` by their numbers, as shares of the longer side.
fn focals(file: &[u8]) -> Option<BTreeMap<u32, f64>> {
    let mut bytes = Bytes { rest: file };
    let mut focals = BTreeMap::new();
    for _ in 0..bytes.u64()? {
        let [camera, model] = [bytes.u32()?, bytes.u32()?];
        let longest = bytes.u64()?.max(bytes.u64()?);
        let [focal] = bytes.numbers()?;
        focals.insert(camera, focal / longest as f64);
        bytes.skip(8 * (*PARAMETERS.get(model as usize)? - 1))?;
    }
    Some(focals)
}

/// The images of `images.bin`, and where their rotations are.
fn images(file: &[u8], focals: &BTreeMap<u32, f64>) -> Option<(Vec<Registered>, Vec<usize>)> {
    let mut bytes = Bytes { rest: file };
    let (mut images, mut at) = (Vec::new(), Vec::new());
    for _ in 0..bytes.u64()? {
        bytes.skip(4)?;
        at.push(file.len() - bytes.rest.len());
        let [w, x, y, z, tx, ty, tz] = bytes.numbers()?;
        let focal = *focals.get(&bytes.u32()?)?;
        let end = bytes.rest.iter().position(|byte| *byte == 0)?;
        let name = String::from_utf8_lossy(&bytes.rest[..end]).into_owned();
        bytes.skip(end + 1)?;
        let features = usize::try_from(bytes.u64()?).ok()?;
        let features = bytes.take(features.checked_mul(24)?)?;
        let observations = features.chunks_exact(24).filter(|feature| feature[16..] != [0xff; 8]).count();
        let rotation = DQuat::from_xyzw(x, y, z, w).normalize();
        images.push(Registered { name, rotation, translation: dvec3(tx, ty, tz), observations, focal });
    }
    Some((images, at))
}

/// The errors of the points in `points3D.bin`, and where their positions are.
fn points(file: &[u8]) -> Option<(Vec<f64>, Vec<usize>)> {
    let mut bytes = Bytes { rest: file };
    let (mut errors, mut at) = (Vec::new(), Vec::new());
    for _ in 0..bytes.u64()? {
        bytes.skip(8)?;
        at.push(file.len() - bytes.rest.len());
        bytes.skip(24 + 3)?;
        let [error] = bytes.numbers()?;
        errors.push(error);
        let track = usize::try_from(bytes.u64()?).ok()?;
        bytes.skip(track.checked_mul(8)?)?;
    }
    Some((errors, at))
}

/// The rest of a file.
struct Bytes<'a> {
    rest: &'a [u8],
}

impl<'a> Bytes<'a> {
    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.rest.split_at_checked(count)?;
        self.rest = rest;
        Some(taken)
    }

    fn skip(&mut self, count: usize) -> Option<()> {
        self.take(count).map(drop)
    }

    fn u32(&mut self) -> Option<u32> {
        Some(u32::from_le_bytes(self.take(4)?.try_into().ok()?))
    }

    fn u64(&mut self) -> Option<u64> {
        Some(u64::from_le_bytes(self.take(8)?.try_into().ok()?))
    }

    fn numbers<const N: usize>(&mut self) -> Option<[f64; N]> {
        let bytes = self.take(8 * N)?;
        let mut numbers = [0.0; N];
        for (number, bytes) in numbers.iter_mut().zip(bytes.chunks_exact(8)) {
            *number = f64::from_le_bytes(bytes.try_into().ok()?);
        }
        Some(numbers)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// The files of a model with these images, and points at these positions.
    pub(crate) fn files(images: &[(&str, DQuat, DVec3)], points: &[DVec3]) -> [(&'static str, Vec<u8>); 3] {
        let number = |value: f64| value.to_le_bytes();
        let mut image_bytes = (images.len() as u64).to_le_bytes().to_vec();
        for (id, (name, rotation, translation)) in images.iter().enumerate() {
            image_bytes.extend((id as u32 + 1).to_le_bytes());
            let DQuat { x, y, z, w } = *rotation;
            [w, x, y, z].into_iter().chain(translation.to_array()).for_each(|value| image_bytes.extend(number(value)));
            image_bytes.extend(1_u32.to_le_bytes());
            image_bytes.extend(name.bytes().chain([0]));
            image_bytes.extend((points.len() as u64 + 1).to_le_bytes());
            for point in (0..points.len() as u64).chain([u64::MAX]) {
                image_bytes.extend(number(1.0).into_iter().chain(number(2.0)).chain(point.to_le_bytes()));
            }
        }
        let mut point_bytes = (points.len() as u64).to_le_bytes().to_vec();
        for (id, point) in points.iter().enumerate() {
            point_bytes.extend((id as u64).to_le_bytes());
            point.to_array().into_iter().for_each(|value| point_bytes.extend(number(value)));
            point_bytes.extend([1, 2, 3].into_iter().chain(number(0.5)).chain(1_u64.to_le_bytes()));
            point_bytes.extend(1_u32.to_le_bytes().into_iter().chain(0_u32.to_le_bytes()));
        }
        let mut camera_bytes = 1_u64.to_le_bytes().to_vec();
        camera_bytes.extend(1_u32.to_le_bytes().into_iter().chain(0_u32.to_le_bytes()));
        camera_bytes.extend(64_u64.to_le_bytes().into_iter().chain(48_u64.to_le_bytes()));
        [60.0, 32.0, 24.0].into_iter().for_each(|value| camera_bytes.extend(number(value)));
        [(FILES[0], point_bytes), (FILES[1], image_bytes), (FILES[2], camera_bytes)]
    }

    #[test]
    fn a_turned_world_shows_the_same_images() {
        let folder = tempfile::tempdir().unwrap();
        let rotation = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -0.8, 1.1);
        let (translation, point) = (dvec3(1.0, 2.0, 3.0), dvec3(0.5, -0.25, 4.0));
        for (name, bytes) in files(&[("a b.jpg", rotation, translation)], &[point]) {
            fs::write(folder.path().join(name), bytes).unwrap();
        }
        let mut model = Model::read(folder.path()).unwrap();
        let image = &model.images[0];
        assert_eq!((image.name.as_str(), image.observations, image.focal), ("a b.jpg", 1, 60.0 / 64.0));
        let turn = DQuat::from_rotation_z(0.7) * DQuat::from_rotation_x(-0.4);
        model.turn(turn, 2.0);
        for (name, bytes) in model.files() {
            fs::write(folder.path().join(name), bytes).unwrap();
        }
        let turned = Model::read(folder.path()).unwrap();
        let image = &turned.images[0];
        let shown = image.rotation * (turn * point * 2.0) + image.translation;
        assert!(shown.abs_diff_eq((rotation * point + translation) * 2.0, 1e-12));
        let mut bytes = Bytes { rest: &turned.files[0][turned.points_at[0]..] };
        assert!(DVec3::from(bytes.numbers::<3>().unwrap()).abs_diff_eq(turn * point * 2.0, 1e-12));
        assert_eq!(turned.errors, [0.5]);
    }

    #[test]
    fn cameras_of_all_kinds_have_focal_lengths() {
        let mut file = 3_u64.to_le_bytes().to_vec();
        for (camera, (kind, numbers)) in [(4_u32, 8), (2, 4), (5, 8)].into_iter().enumerate() {
            file.extend([7 + camera as u32, kind].into_iter().flat_map(u32::to_le_bytes));
            file.extend([300_u64, 400].into_iter().flat_map(u64::to_le_bytes));
            file.extend((0..numbers).flat_map(|i| f64::from(100 * (camera as u32 + 1) + i).to_le_bytes()));
        }
        assert_eq!(focals(&file), Some(BTreeMap::from([(7, 0.25), (8, 0.5), (9, 0.75)])));
        file[12] = 11;
        assert_eq!(focals(&file), None, "there is no model 11");
    }

    #[test]
    fn a_model_that_ends_early_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        for (name, bytes) in files(&[("a.jpg", DQuat::IDENTITY, DVec3::ZERO)], &[DVec3::ONE]) {
            let end = bytes.len() - usize::from(name == FILES[1]);
            fs::write(folder.path().join(name), &bytes[..end]).unwrap();
        }
        let error = Model::read(folder.path()).unwrap_err().to_string();
        assert!(error.contains("images.bin") && error.contains("ends early"), "{error}");
    }
}
