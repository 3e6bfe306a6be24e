//! Training of 3D scenes from posed images, by 3DGS and other methods.
//!
//! [`Trainer3d`] is the loop of [`Trainer`](crate::Trainer) with [`Views`] in place of one image.
//! Its settings are [`TrainSettings`], with presets in [`TrainPreset`]; [`Start`] gives the first
//! Gaussians. [`evaluate`] measures the quality of any scene on any views.

mod beginning;
mod evaluation;
mod evidence;
mod exposure;
mod first_poses;
mod poses;
mod presets;
mod rendered_depths;
mod settings;
mod summary;
mod task;
mod trainer;
mod trial;
mod unseen;
mod usual_start;

#[cfg(feature = "edit")]
pub(crate) use self::evaluation::measure;
pub(crate) use self::evidence::plain;
pub use self::{
    evaluation::{ColorMatched, Evaluation, Look, PoseMatched, TrainingViews, ViewQuality, evaluate, evaluate_aligned},
    exposure::{Exposure, ExposureReport},
    poses::{PosesReport, RefinePoses},
    presets::TrainPreset,
    settings::TrainSettings,
    summary::{DRIFT_DB, TrainSummary},
    trainer::Trainer3d,
    trial::report::TrialReport,
};
#[cfg(feature = "edit")]
pub(crate) use self::{
    exposure::Exposures,
    poses::{Poses, pose_of, with_pose},
    task::shown,
};
pub use crate::{
    start::{PointInit, Start, StartName},
    views::{Counting, Focus, ImageReading, ImageSource, PosedView, Resolution, Views, extent_of},
};
