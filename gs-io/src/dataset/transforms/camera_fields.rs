//! Intrinsics in a `transforms.json`: shared by all frames, or a frame's own.

use std::{
    f64::consts::PI,
    path::{Path, PathBuf},
};

use glam::{DVec2, dvec2};
use serde_json::Value;

use crate::{
    dataset::{
        Skip,
        camera::{Focal, Intrinsics},
        read::{CameraFields, Refusal, Stated},
    },
    error::Error,
};

/// Values of `camera_model` for the perspective model; the first is the default.
const PERSPECTIVE: [&str; 6] = ["OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE"];
const FISHEYE: [&str; 4] = ["OPENCV_FISHEYE", "FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE"];
const PANORAMA: &str = "EQUIRECTANGULAR";

/// Focal lengths in x and y, px.
const LENGTHS: [&str; 2] = ["fl_x", "fl_y"];

/// Angles of view in x and y by unit, with the unit in rad.
const ANGLES: [([&str; 2], f64, &str); 2] =
    [(["camera_angle_x", "camera_angle_y"], 1.0, "rad"), (["x_fov", "y_fov"], PI / 180.0, "degrees")];

/// Radius of a fish-eye's image circle about the principal point, px.
const CIRCLE: &str = "fisheye_crop_radius";

/// All keys of numbers.
const NUMBERS: [&str; 17] = [
    "camera_angle_x",
    "camera_angle_y",
    "x_fov",
    "y_fov",
    "fl_x",
    "fl_y",
    "cx",
    "cy",
    "w",
    "h",
    "k1",
    "k2",
    "k3",
    "k4",
    "p1",
    "p2",
    CIRCLE,
];

impl CameraFields<'_> {
    fn has_own(&self, keys: &[&str]) -> bool {
        keys.iter().any(|key| self.own.get(*key).is_some_and(|value| !value.is_null()))
    }

    /// Two numbers that are given together or not at all.
    fn pair(&self, keys: [&str; 2], least: f64, range: &str) -> Result<Option<DVec2>, String> {
        let number = |key| self.between(key, least, f64::INFINITY, range);
        match (number(keys[0])?, number(keys[1])?) {
            (Some(x), Some(y)) => Ok(Some(dvec2(x, y))),
            (None, None) => Ok(None),
            (Some(_), None) => Err(format!("{} is missing, but {} is there", keys[1], keys[0])),
            (None, Some(_)) => Err(format!("{} is missing, but {} is there", keys[0], keys[1])),
        }
    }

    fn focal(&self) -> Result<Focal, String> {
        let length = |key| self.between(key, 0.0, f64::INFINITY, "greater than 0");
        let (x, y) = (length(LENGTHS[0])?, length(LENGTHS[1])?);
        // A frame's own angle is closer to it than a length that all frames share.
        let own_angles = !self.has_own(&LENGTHS) && ANGLES.iter().any(|(keys, ..)| self.has_own(keys));
        if let Some(some) = x.or(y).filter(|_| !own_angles) {
            return Ok(Focal::Lengths(dvec2(x.unwrap_or(some), y.unwrap_or(some))));
        }
        for (keys, unit, name) in ANGLES {
            let angle = |key| {
                let range = format!("between 0 and {} {name}", if unit == 1.0 { "π" } else { "180" });
                Ok::<_, String>(self.between(key, 0.0, PI / unit, &range)?.map(|angle| angle * unit))
            };
            match (angle(keys[0])?, angle(keys[1])?) {
                (None, None) => {}
                (x, y) => return Ok(Focal::Angles(x, y)),
            }
        }
        let keys = [LENGTHS, ANGLES[0].0, ANGLES[1].0].concat().join(", ");
        Err(format!("there is no focal length, such as in one of {keys}"))
    }

    /// The intrinsics in the file at `path`.
    ///
    /// # Errors
    /// [`Error::Unusable`] for an unknown model; inside, why the camera is impossible, with the key.
    pub(super) fn intrinsics(&self, path: &Path) -> Result<Result<Intrinsics, Refusal>, Error> {
        let fisheye = self.get("is_fisheye").and_then(Value::as_bool).unwrap_or_default();
        let usual = if fisheye { FISHEYE[0] } else { PERSPECTIVE[0] };
        let model = self.get("camera_model").map_or_else(
            || usual.to_owned(),
            |model| match model {
                Value::String(name) => name.clone(),
                other => other.to_string(),
            },
        );
        let is_fisheye = FISHEYE.contains(&model.as_str());
        if !is_fisheye && model != PANORAMA && !PERSPECTIVE.contains(&model.as_str()) {
            let known = [&FISHEYE[..], &PERSPECTIVE, &[PANORAMA]].concat().join(", ");
            let found: String = model.chars().filter(|c| !c.is_control()).take(40).collect();
            return Err(Error::unknown_camera_model(path, found, &known));
        }
        let numbers = || -> Result<Intrinsics, String> {
            let size = self.pair(["w", "h"], 0.0, "greater than 0")?;
            // The lengths fl_x, fl_y, cx and cy of a 360° image follow from its size.
            if model == PANORAMA {
                return Ok(Intrinsics::panorama(size));
            }
            let distortion = self.distortion(is_fisheye)?;
            let center = self.pair(["cx", "cy"], f64::NEG_INFINITY, "a number")?;
            let circle = match is_fisheye {
                true => self.between(CIRCLE, 0.0, f64::INFINITY, "greater than 0")?,
                false => None,
            };
            Ok(Intrinsics { focal: self.focal()?, center, size, distortion, circle })
        };
        let file = PathBuf::from(path.file_name().unwrap_or_default());
        Ok(numbers().map_err(|fault| Refusal::new(Skip::BadCamera, format!("in {}, {fault}", file.display()))))
    }

    /// The numbers with their keys, for messages.
    pub(super) fn stated(&self, path: &Path) -> Stated {
        let place = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        Stated { place, numbers: self.numbers(NUMBERS) }
    }
}
