//! Unit quaternions, which most formats require. Scenes may have any length but 0.

use std::path::Path;

use gs_core::{Scene3d, constants::MIN_QUATERNION_NORM2};

use crate::error::Error;

/// Tolerance of a squared length of 1: a few roundings of `f32`.
const UNIT_TOLERANCE: f32 = 1e-6;

/// The rotations of a scene without zero quaternions.
#[derive(Debug)]
pub(crate) struct UnitRotations<'a>(&'a Scene3d);

impl<'a> UnitRotations<'a> {
    /// Fails for the first quaternion that is too short to be normalised; such a Gaussian is never
    /// drawn.
    pub(crate) fn new(scene: &'a Scene3d, path: &Path) -> Result<Self, Error> {
        match scene.rotations.iter().position(|q| !(norm2(q) >= MIN_QUATERNION_NORM2)) {
            None => Ok(Self(scene)),
            Some(i) => {
                let q = scene.rotations[i];
                let message = format!("the quaternion of Gaussian {i} is {q:?}, too short to be a rotation; remove it");
                Err(Error::content(path)(gs_core::Error::State(message)))
            }
        }
    }

    /// (w, x, y, z) of Gaussian `i`; bit-identical to the scene's if that is a unit quaternion to
    /// rounding.
    pub(crate) fn get(&self, i: usize) -> [f32; 4] {
        let q = self.0.rotations[i];
        if is_unit(&q) {
            return q;
        }
        let length = q.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>().sqrt();
        q.map(|v| (f64::from(v) / length) as f32)
    }

    /// Whether all quaternions have unit length already.
    pub(crate) fn all_unit(&self) -> bool {
        self.0.rotations.iter().all(is_unit)
    }
}

fn norm2(q: &[f32; 4]) -> f32 {
    q.iter().map(|v| v * v).sum()
}

fn is_unit(q: &[f32; 4]) -> bool {
    (norm2(q) - 1.0).abs() <= UNIT_TOLERANCE
}
