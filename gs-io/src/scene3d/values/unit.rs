//! Unit quaternions, which most formats require. Scenes may have any length but 0.

use std::path::Path;

use gs_core::{Scene3d, constants::MIN_QUATERNION_NORM2};

use crate::{error::Error, scene3d::ConversionLoss};

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

    /// The loss of lengths, if not all are 1 already.
    pub(crate) fn loss(&self) -> Option<ConversionLoss> {
        (!self.0.rotations.iter().all(is_unit)).then_some(ConversionLoss::QuaternionLengths)
    }
}

/// The index of the largest component of a quaternion: the first of equal ones.
pub(crate) fn largest_of(q: [f32; 4]) -> usize {
    (1..4).fold(0, |largest, k| if q[k].abs() > q[largest].abs() { k } else { largest })
}

/// The unit quaternion with these three components in their order and the one at `largest`, which
/// follows from them.
pub(crate) fn with_largest(largest: usize, others: [f32; 3]) -> [f32; 4] {
    let rest = 1.0 - others.iter().map(|v| v * v).sum::<f32>();
    let mut others = others.into_iter();
    // The largest is taken out of order; the others follow in theirs.
    std::array::from_fn(|k| if k == largest { rest.max(0.0).sqrt() } else { others.next().unwrap_or(0.0) })
}

fn norm2(q: &[f32; 4]) -> f32 {
    q.iter().map(|v| v * v).sum()
}

fn is_unit(q: &[f32; 4]) -> bool {
    (norm2(q) - 1.0).abs() <= UNIT_TOLERANCE
}
