//! The training loop of every kind of training, and what is recorded of a run.
//!
//! A [`Trainer`] does the steps and rounds of density control of a [`Trainable`] scene. [`Observer`]s
//! watch it; [`Recovery`] restarts it where it diverges.

mod checkpoint;
mod clamped;
mod losses;
mod metrics_log;
mod observer;
mod quality;
mod recovery;
mod rounds;
mod settings_file;
mod shortfall;
mod suspect;
mod task;
mod trainer;

pub(crate) use self::{
    checkpoint::{Record, digest, fingerprint, table, to_table},
    quality::{infinite_where_null, psnr_float},
    settings_file::in_a_file,
    task::{At, StepContext, TrainingTask, same_settings},
    trainer::{Average, random},
};
pub use self::{
    clamped::Clamped,
    metrics_log::{MetricsLog, MetricsRow},
    observer::{Control, Observer, Progress, Quality},
    quality::ImageQuality,
    recovery::{FreshStart, Recovery},
    rounds::Rounds,
    settings_file::{SettingsFile, parse_json, parse_settings, settings_to_toml},
    shortfall::Shortfall,
    suspect::Suspect,
    task::{LoopSettings, RunSettings, Trainable},
    trainer::{CustomPolicy, Outcome, Trainer},
};
