//! Reads the records of COLMAP's three files, whether they are binary or text.

use std::{collections::BTreeMap, str::FromStr};

use glam::{DQuat, DVec2, DVec3};

use super::{CameraModel, ColmapCamera, ColmapImage, ColmapObservation, ColmapPoint};
use crate::error::Error;

/// The kind of each of the files, for messages.
pub(super) const WHAT: &str = "a file of a COLMAP model";

/// The records of a file, one after the other. A method's `expected` names its value in messages.
pub(super) trait Records: Sized {
    /// Goes to the next record. Returns whether there is one.
    fn next(&mut self) -> Result<bool, Error>;

    fn number<T: Number>(&mut self, expected: &str) -> Result<T, Error>;

    fn numbers<const N: usize>(&mut self, expected: &str) -> Result<[f64; N], Error> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.number(expected)?;
        }
        Ok(values)
    }

    fn model(&mut self) -> Result<CameraModel, Error>;

    fn name(&mut self) -> Result<String, Error>;

    /// The keypoints of the image of this name.
    fn observations(&mut self, name: &str) -> Result<Vec<ColmapObservation>, Error>;

    /// The position of a keypoint.
    fn keypoint(&mut self) -> Result<DVec2, Error> {
        self.numbers("a keypoint x y").map(DVec2::from_array)
    }

    /// Skips the list of images that show a point.
    fn pass_over_track(&mut self) -> Result<(), Error>;

    /// Fails if the record has more values.
    fn end(&mut self) -> Result<(), Error>;
}

/// A number of a record.
pub(super) trait Number: FromStr {
    /// Size in binary files, bytes.
    const BYTES: usize = size_of::<Self>();

    /// The number from its little-endian bytes; `None` for another number of bytes than
    /// [`Self::BYTES`].
    fn of_bytes(bytes: &[u8]) -> Option<Self>;
}

macro_rules! numbers {
    ($($name:ty),*) => {$(
        impl Number for $name {
            fn of_bytes(bytes: &[u8]) -> Option<Self> {
                bytes.try_into().ok().map(Self::from_le_bytes)
            }
        }
    )*};
}

numbers!(u8, u32, u64, f64);

/// Id, model, columns, rows, parameters.
pub(super) fn cameras(mut records: impl Records) -> Result<BTreeMap<u32, ColmapCamera>, Error> {
    let mut cameras = BTreeMap::new();
    while records.next()? {
        let id = records.number("a camera's number")?;
        let model = records.model()?;
        let (width, height) = (records.number("a width in px")?, records.number("a height in px")?);
        let parameters = model.parameter_names().iter().map(|name| records.number(name)).collect::<Result<_, _>>()?;
        records.end()?;
        cameras.insert(id, ColmapCamera { model, width, height, parameters });
    }
    Ok(cameras)
}

/// Id, quaternion w x y z, translation, camera, name, keypoints.
pub(super) fn images(mut records: impl Records) -> Result<Vec<ColmapImage>, Error> {
    let mut images = Vec::new();
    while records.next()? {
        let id = records.number("an image's number")?;
        let [w, x, y, z] = records.numbers("a quaternion w x y z")?;
        let translation = DVec3::from_array(records.numbers("a translation")?);
        let camera_id = records.number("a camera's number")?;
        let name = records.name()?;
        let observations = records.observations(&name)?;
        let rotation = DQuat::from_xyzw(x, y, z, w);
        images.push(ColmapImage { id, rotation, translation, camera_id, name, observations });
    }
    Ok(images)
}

/// Id, position, colour, error, track.
pub(super) fn points(mut records: impl Records) -> Result<Vec<ColmapPoint>, Error> {
    let mut points = Vec::new();
    while records.next()? {
        let id = records.number("a point's number")?;
        let position = DVec3::from_array(records.numbers("a position")?);
        let mut channel = |name: &str| records.number(&format!("{name}, 0 to 255"));
        let color = [channel("red")?, channel("green")?, channel("blue")?];
        let error = records.number("an error in px")?;
        records.pass_over_track()?;
        points.push(ColmapPoint { id, position, color, error });
    }
    Ok(points)
}
