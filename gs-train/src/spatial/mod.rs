//! Training of scenes in space from posed photographs, as 3DGS does it and beyond.
//!
//! [`SpatialTrainer`] is the loop of [`Trainer`](crate::Trainer) with [`Views`] in place of one image. What it does is in its
//! [`SpatialSettings`], which [`SpatialPreset`] names; where it begins says [`Start`]. [`evaluate`] judges any scene by any views.

mod course;
mod evaluation;
mod flat;
mod flight;
mod geometry;
mod init;
mod neighbours;
mod order;
mod pictures;
mod presets;
mod resolution;
mod settings;
mod summary;
mod trainer;
mod view_dependence;
mod views;

pub use self::{
    course::ViewsCourse,
    evaluation::{Evaluation, TrainingViews, ViewQuality, evaluate},
    flat::Flat,
    flight::{Bulk, CameraPath, Ends, Key, Orbit, looking_at, resized},
    geometry::{Focus, extent_of},
    init::{PointInit, Start, gaussians_at, random_points},
    neighbours::neighbour_distances,
    presets::SpatialPreset,
    resolution::Resolution,
    settings::{Backdrop, SpatialSettings},
    summary::{DRIFT_DB, SpatialSummary},
    trainer::SpatialTrainer,
    view_dependence::ViewDependence,
    views::{Counting, PhotographSource, PosedView, Views},
};

pub(crate) use self::course::shown;
