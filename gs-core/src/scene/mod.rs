//! Scenes on the host: plain, serialisable sets of Gaussians. A backend's copy of a scene is its
//! `Splats`.

mod lod;
mod region;
mod scene2d;
mod scene3d;
mod thinned;

use std::fmt::Debug;

pub use lod::{Bounds, LodCut, LodLevel, LodNode};
pub use region::Region;
pub use scene2d::{Gaussian2d, Scene2d};
pub use scene3d::{Gaussian3d, Scene3d};

use crate::error::Error;

/// A kind of scene: its Gaussians and its views.
pub trait Scene: Clone + Debug + Default + PartialEq + Send + Sync {
    /// A view of the scene: [`Canvas`](crate::Canvas) or [`Camera`](crate::Camera).
    type View: Clone + Debug + Send + Sync;
    /// One Gaussian with all its parameters.
    type Gaussian: Clone + Debug + PartialEq + Send + Sync;

    /// Number of Gaussians, N.
    fn len(&self) -> usize;

    /// Whether N = 0.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Gaussian `index`.
    ///
    /// # Panics
    /// Where `index >= len()`.
    fn gaussian(&self, index: usize) -> Self::Gaussian;

    /// Appends one Gaussian.
    ///
    /// # Panics
    /// Where a 3D Gaussian has coefficients of another degree than the scene.
    fn push(&mut self, gaussian: Self::Gaussian);

    /// Checks that all arrays describe the same number of Gaussians. Their values may be anything,
    /// even NaN.
    ///
    /// # Errors
    /// [`Error::Length`] naming the first array that does not; [`Error::Setting`] for an impossible
    /// SH degree.
    fn check_lengths(&self) -> Result<(), Error>;

    /// Checks the lengths of all arrays and that all values are finite. Opacity logits may be ±∞:
    /// they render as opaque and as invisible.
    ///
    /// # Errors
    /// Those of [`Self::check_lengths`]; [`Error::NotFinite`] naming the first value that is not
    /// finite.
    fn validate(&self) -> Result<(), Error>;
}

/// The opacity of a logit: 1 / (1 + exp(−x)).
pub fn sigmoid(logit: f32) -> f32 {
    1.0 / (1.0 + (-logit).exp())
}

/// The logit of an opacity in 0..=1: ln(p / (1 − p)), ±∞ at the ends.
pub fn logit(opacity: f32) -> f32 {
    (opacity / (1.0 - opacity)).ln()
}

/// Checks the length of an array; `what` names it in the error.
///
/// # Errors
/// [`Error::Length`] where it is not as expected.
pub fn check_len(what: &'static str, expected: usize, found: usize) -> Result<(), Error> {
    if found == expected { Ok(()) } else { Err(Error::Length { what, expected, found }) }
}

fn check_finite(what: &'static str, index: usize, values: &[f32]) -> Result<(), Error> {
    match values.iter().find(|v| !v.is_finite()) {
        None => Ok(()),
        Some(&value) => Err(Error::NotFinite { what, index, value }),
    }
}

fn check_logit(index: usize, value: f32) -> Result<(), Error> {
    if value.is_nan() { Err(Error::NotFinite { what: "opacity logit", index, value }) } else { Ok(()) }
}
