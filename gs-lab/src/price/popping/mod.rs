//! Popping: colours that jump while the camera moves, because the order of the Gaussians changes, or their level of
//! detail.
//!
//! On a [`SlowOrbit`] around any scene, [`popping_prices`] compares both orders of blending, and
//! [`popping_prices_of_levels`] levels that change at once and with transitions.

mod comparison;
mod flicker;
mod pictures;
mod report;
#[cfg(test)]
mod tests;
mod ways;

pub use self::{
    comparison::SlowOrbit,
    report::{PoppingPrices, popping_prices, popping_prices_of_levels},
};
