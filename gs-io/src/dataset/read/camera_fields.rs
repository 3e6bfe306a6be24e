//! The fields of a camera in JSON.

use serde_json::{Map, Value};

use super::{number_of, shown};
use crate::dataset::{BrownConrady, Distortion, Fisheye};

/// The fields of a camera, completed by those that all cameras share. A value of `null` is missing.
pub(crate) struct CameraFields<'a> {
    pub(crate) own: &'a Map<String, Value>,
    pub(crate) shared: Option<&'a Map<String, Value>>,
}

impl CameraFields<'_> {
    pub(crate) fn get(&self, key: &str) -> Option<&Value> {
        let all = [Some(self.own), self.shared].into_iter().flatten();
        all.filter_map(|fields| fields.get(key)).find(|value| !value.is_null())
    }

    /// A finite number; the error says what there is instead.
    pub(crate) fn number(&self, key: &str) -> Result<Option<f64>, String> {
        let Some(value) = self.get(key) else { return Ok(None) };
        match number_of(value) {
            Some(number) if number.is_finite() => Ok(Some(number)),
            _ => Err(format!("{key} is {}, but must be a number", shown(value))),
        }
    }

    /// A number between two others.
    pub(crate) fn between(&self, key: &str, least: f64, most: f64, range: &str) -> Result<Option<f64>, String> {
        match self.number(key)? {
            Some(number) if !(number > least && number < most) => {
                Err(format!("{key} is {number}, but must be {range}"))
            }
            number => Ok(number),
        }
    }

    /// The distortion by OpenCV's coefficients; those that are missing are 0.
    pub(crate) fn distortion(&self, is_fisheye: bool) -> Result<Distortion, String> {
        let number = |key| Ok::<_, String>(self.number(key)?.unwrap_or_default());
        let radial = [number("k1")?, number("k2")?, number("k3")?, number("k4")?];
        let tangential = [number("p1")?, number("p2")?];
        let brown = BrownConrady { radial, tangential, ..BrownConrady::default() };
        Ok(match is_fisheye {
            true => Distortion::Fisheye(Fisheye { radial, ..Fisheye::default() }),
            false if brown == BrownConrady::default() => Distortion::None,
            false => Distortion::BrownConrady(brown),
        })
    }

    /// The numbers of these keys, for messages.
    pub(crate) fn numbers<const N: usize>(&self, keys: [&'static str; N]) -> Vec<(&'static str, f64)> {
        keys.into_iter().filter_map(|key| Some((key, number_of(self.get(key)?)?))).collect()
    }
}
