//! Fits of 2D Gaussians to an image: settings, presets, the first Gaussians, and the result.

mod flat;
pub mod init;
mod presets;
mod settings;
mod summary;
mod target;
mod task;
mod tune;
mod whole_fit;

pub use self::{
    flat::mean_color,
    init::{Init, InitKind},
    presets::Preset,
    settings::{ColorSolve, FitSettings, InitialCount},
    summary::FitSummary,
    target::{DiscAndSquare, Fill, PAPER_DISC, PAPER_SIDE_PX, PAPER_SQUARE, paper_target},
    tune::Tune,
    whole_fit::{Fit, FitTarget, fit},
};
