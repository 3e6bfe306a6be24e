//! Popping: colours that jump while the camera moves, because the order of the Gaussians changes.
//!
//! [`popping_prices`] measures both sort orders on a [`SlowOrbit`] around any scene.

mod comparison;
mod flicker;
mod pictures;
mod report;
#[cfg(test)]
mod tests;

pub use self::{
    comparison::SlowOrbit,
    report::{PoppingPrices, popping_prices},
};
