#![doc = include_str!("../README.md")]
//! # Start reading at
//!
//! - [`fit()`] fits an image in one call; [`Trainer3d`] trains a 3D scene.
//! - [`encode()`] makes a compressed `.gsi` file of an image.
//! - [`Trainer`] is the loop itself, for programs that stop, store and resume it.
//! - [`FitSettings`] and [`TrainSettings`] are all that a run depends on; [`Preset`] and
//!   [`TrainPreset`] name good ones.
//! - [`Observer`] watches a run and can stop it.

// Guards are phrased so that NaN fails them: `!(x > 0.0)` is not `x <= 0.0`.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

mod checkpoint;
mod clamped;
mod count;
mod draw;
mod encode;
mod error;
mod fit;
mod flat;
mod forecast;
pub mod init;
mod losses;
pub mod memory;
mod metrics_log;
mod observer;
mod presets;
mod quality;
mod recovery;
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
mod tune;
mod viewable;

#[doc(hidden)]
pub use crate::task::{RunSettings, SceneTask, TrainingTask};
pub use crate::{
    clamped::Clamped,
    count::count_for_psnr,
    draw::draw_picture,
    encode::{
        EncodeImage, EncodeLayers, EncodeProgress, EncodeSettings, EncodeTarget, EncodeWork, Encoded, encode,
        encode_observed,
    },
    error::Error,
    fit::{Fit, FitTarget, fit},
    flat::mean_color,
    init::Init,
    metrics_log::{MetricsLog, MetricsRow},
    observer::{Control, Observer, Progress, Quality},
    presets::Preset,
    quality::{ImageQuality, l1_and_psnr},
    recovery::{FreshStart, Recovery},
    rounds::Rounds,
    settings::{ColorSolve, FitSettings, InitialCount},
    settings_file::{parse_json, parse_settings, settings_to_toml},
    shortfall::Shortfall,
    summary::FitSummary,
    suspect::Suspect,
    target::{DiscAndSquare, Fill, PAPER_DISC, PAPER_SIDE_PX, PAPER_SQUARE, paper_target},
    task::Trainable,
    train::{TrainPreset, TrainSettings, Trainer3d},
    trainer::{ForeignPolicy, Outcome, Trainer},
    tune::Tune,
    viewable::{ColorRange, Viewable, viewable},
};
