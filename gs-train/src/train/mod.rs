//! Training of 3D scenes from posed photographs, as 3DGS does it and beyond.
//!
//! [`Trainer3d`] is the loop of [`Trainer`](crate::Trainer) with [`Views`] in place of one image. What it does is in its
//! [`TrainSettings`], which [`TrainPreset`] names; where it begins says [`Start`]. [`evaluate`] judges any scene by any views.

mod evaluation;
mod flat;
mod geometry;
mod init;
mod neighbours;
mod order;
mod pictures;
mod presets;
mod resolution;
mod settings;
mod summary;
mod task;
mod trainer;
mod views;

pub use self::{
    evaluation::{Evaluation, TrainingViews, ViewQuality, evaluate},
    flat::Flat,
    geometry::{Focus, extent_of},
    init::{PointInit, Start, gaussians_at, random_points},
    neighbours::neighbour_distances,
    presets::TrainPreset,
    resolution::Resolution,
    settings::{StepBackground, TrainSettings},
    summary::{DRIFT_DB, TrainSummary},
    task::ViewsTask,
    trainer::Trainer3d,
    views::{Counting, ImageSource, PosedView, Views},
};
