//! Popping: colours that jump while the camera moves, because the order of the Gaussians changes.
//!
//! [`popping_prices`] measures both sort orders on a [`SlowOrbit`] around any scene.

mod comparison;
mod flicker;
mod pictures;
mod report;
mod scenes;

pub use self::{comparison::SlowOrbit, report::popping_prices};
pub(crate) use self::{
    comparison::{ORDERS, PoppingComparison, VISIBLE_LEVELS, compare, ordered},
    pictures::picture,
    report::{STEP_COLUMNS, rows, trajectory_chart},
    scenes::{ball_flight, ball_in_sea, discs, discs_flight, px_per_unit},
};
