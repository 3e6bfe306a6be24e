//! The training loop: initialisers, schedules, density control, observers and checkpoints.
//!
//! [`fit()`] fits an image in one call. [`Trainer`] is the loop itself, for who wants to stop, store and resume it. What a fit does
//! is in its [`FitSettings`]; [`Preset`] names the good ones. [`Observer`] is how a caller watches and stops it. All of it is
//! generic over the backend: any [`Rasterizer`](gs_core::Rasterizer) of 2D scenes.

// Guards are phrased so that NaN fails them: `!(x > 0.0)` is not `x <= 0.0`.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

mod checkpoint;
mod clamped;
mod effect_schedule;
mod error;
mod fit;
mod flat;
pub mod init;
mod losses;
pub mod memory;
mod metrics_log;
mod observer;
mod open;
pub mod presets;
mod quality;
pub mod recovery;
mod rounds;
mod settings;
mod settings_file;
mod shortfall;
mod summary;
mod suspect;
mod target;
mod task;
pub mod train;
mod trainer;
mod viewable;

/// Makes the examples of the README compile.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
struct Readme;

pub use crate::{
    clamped::Clamped,
    error::Error,
    fit::task::ImageTask,
    fit::{Fit, fit},
    flat::{flat_color, mean_color},
    init::Init,
    metrics_log::{MetricsLog, MetricsRow},
    observer::{Control, Observer, Progress, Quality},
    open::{Opened, OpenedScene, SCENE_NAMES, Values, is_scene, open_scene, scene_in},
    presets::Preset,
    quality::{ImageQuality, l1_and_psnr},
    recovery::{FreshStart, Recovery},
    rounds::Rounds,
    settings::{ColorSolve, FitSettings, InitialCount, gaussians_for},
    settings_file::{parse_settings, settings_to_toml},
    shortfall::Shortfall,
    summary::FitSummary,
    suspect::Suspect,
    target::{DiscAndSquare, Fill, PAPER_DISC, PAPER_SIDE_PX, PAPER_SQUARE, paper_target},
    task::{RunSettings, StepContext, Trainable, TrainingTask},
    train::{TrainPreset, TrainSettings, Trainer3d},
    trainer::{ForeignPolicy, Outcome, Trainer},
    viewable::{ColorRange, Viewable, viewable},
};
