//! What an approximation costs, in time, error, flicker and by stage.
//!
//! One engine measures for all: a [`Contender`] is a scene on a machine; settings are timed in turn,
//! after a warm-up, and compared by their medians and their [`Noise`]; pictures are compared with a
//! true one ([`PictureError`]), by another rendering or by the 64-bit oracle. The questions are:
//!
//! - [`effect_prices`]: which effects a scene requires, and what each costs and changes;
//!   [`training_prices`] asks that of corrections in a training.
//! - [`frontier`]: which settings are the quickest for an error, over all settings and machines.
//! - [`popping`]: how much colours jump while the camera moves.
//! - [`stage_prices`]: where the time of a training step goes.
//!
//! Each answer has a [`Table`](crate::report::Table), and is JSON by its serialisation.

mod effects;
pub mod frontier;
mod machine;
mod noise;
mod picture_error;
pub mod popping;
mod stages;
mod timing;
mod training;
mod truth;
mod views;

pub(crate) use self::machine::{Loaded, Renderer};
pub use self::{
    effects::{EffectPrices, effect_prices},
    machine::{Contender, contenders},
    noise::Noise,
    picture_error::PictureError,
    stages::{StagePrices, stage_prices},
    timing::Times,
    training::{TrainingPrices, training_prices},
    truth::Verifiable,
    views::{sampled, unseen_cameras, unseen_canvases},
};
