//! What an approximation costs, in time, error, flicker and by stage.
//!
//! One engine measures for all: settings are timed in turn, after a warm-up, and compared by their
//! medians and their noise; pictures are compared with another rendering. The questions are:
//!
//! - [`effect_prices`]: which effects a scene requires, and what each costs and changes;
//!   [`training_prices`] asks that of corrections in a training.
//! - [`Search`]: what each setting costs in time and error, on every machine.
//! - [`popping_prices`], [`popping_prices_of_levels`]: how much colours jump while the camera moves.
//! - [`stage_prices`]: where the time of a training step goes.
//!
//! Each answer has a text, and is JSON by its serialisation.

mod effects;
pub(crate) mod frontier;
mod machine;
mod noise;
mod picture_error;
mod popping;
mod stages;
mod timing;
mod training;

pub(crate) use self::machine::{Loaded, Renderer};
pub use self::{
    effects::{EffectPrices, effect_prices},
    frontier::{Frontier, Search},
    popping::{PoppingPrices, SlowOrbit, popping_prices, popping_prices_of_levels},
    stages::{StagePrices, stage_prices},
    training::{TrainingPrices, training_prices},
};
