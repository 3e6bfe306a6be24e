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

#[cfg(feature = "edit")]
pub mod blocks;
#[cfg(feature = "edit")]
pub mod edit;
mod encode;
mod error;
mod fit;
pub mod limits;
pub mod memory;
mod run;
mod start;
pub mod train;
mod views;

pub use crate::{
    encode::{
        EncodeImage, EncodeLayers, EncodeProgress, EncodeSettings, EncodeTarget, EncodeWork, Encoded, draw_picture,
        encode,
    },
    error::Error,
    fit::{
        ColorSolve, DiscAndSquare, Fill, Fit, FitSettings, FitSummary, FitTarget, Init, InitKind, InitialCount,
        PAPER_DISC, PAPER_SIDE_PX, PAPER_SQUARE, Preset, Tune, fit, init, mean_color, paper_target,
    },
    run::{
        Clamped, Control, CustomPolicy, FreshStart, ImageQuality, LoopSettings, MetricsLog, MetricsRow, Observer,
        Outcome, Progress, Quality, Recovery, Rounds, RunSettings, SettingsFile, Shortfall, Suspect, Trainable,
        Trainer, parse_json, parse_settings, settings_to_toml,
    },
    train::{TrainPreset, TrainSettings, Trainer3d},
};
