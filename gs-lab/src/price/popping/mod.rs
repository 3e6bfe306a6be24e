//! Popping: colours that jump while the camera moves, because the order of the Gaussians changes.
//!
//! [`compare`] measures both sort orders on a [`SlowOrbit`] around any scene.

mod comparison;
mod flicker;
mod scenes;

pub(crate) use self::{
    comparison::{AtStep, Moment, ORDERS, Popping, VISIBLE_LEVELS, ordered},
    scenes::{ball_flight, ball_in_sea, discs_flight, px_per_unit},
};
pub use self::{
    comparison::{PoppingComparison, STRIDES, SlowOrbit, compare},
    scenes::discs,
};
