//! Training of 3D scenes from posed images, by 3DGS and other methods.
//!
//! [`Trainer3d`] is the loop of [`Trainer`](crate::Trainer) with [`Views`] in place of one image.
//! Its settings are [`TrainSettings`], with presets in [`TrainPreset`]; [`Start`] gives the first
//! Gaussians. [`evaluate`] measures the quality of any scene on any views.

mod color_map;
mod depth_fit;
mod depth_loss;
mod depths;
mod evaluation;
mod evidence;
mod exposure;
mod faces;
mod flat;
mod geometry;
mod idle;
mod images;
mod init;
mod neighbours;
mod order;
mod presets;
mod reduction;
mod resolution;
mod settings;
mod shell;
mod speed;
mod start_name;
mod summary;
mod sweep;
mod task;
mod trainer;
mod unseen;
mod views;

pub use self::{
    depth_loss::{DepthLoss, DepthMapCounts},
    evaluation::{ColorMatched, Evaluation, TrainingViews, ViewQuality, evaluate},
    exposure::{Exposure, ExposureReport},
    flat::Flat,
    geometry::{Focus, extent_of},
    init::{PointInit, Start},
    presets::TrainPreset,
    reduction::{Reduced, reduce},
    resolution::Resolution,
    settings::{StepBackground, TrainSettings},
    speed::Speed,
    start_name::StartName,
    summary::{DRIFT_DB, TrainSummary},
    trainer::Trainer3d,
    views::{Counting, ImageSource, PosedView, Views},
};
