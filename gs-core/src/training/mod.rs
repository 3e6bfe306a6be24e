//! Training: the optimizer, losses, statistics for density control, and edits of a scene.

pub mod adam;
pub mod edit;
mod loss;
mod noise;
mod statistics;

pub use self::{
    loss::Loss,
    noise::{MeanNoise, random_words},
    statistics::{CullCause, Culled, DensityStatistics},
};
