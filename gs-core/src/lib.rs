#![doc = include_str!("../README.md")]
//! # Start reading at
//!
//! - [`Rasterizer`] draws scenes and differentiates their images; [`Optimizer`] trains where the
//!   backend computes.
//! - [`Scene2d`] and [`Scene3d`] are scenes, [`Canvas`] and [`Camera`] what they are looked at through.
//! - The module `splat` is what one Gaussian does at one pixel, `perspective` how a 3D Gaussian gets
//!   there.
//! - [`constants`] has every number that backends must agree on.

// Guards are phrased so that NaN fails them: `!(x > 0.0)` is not `x <= 0.0`.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

pub mod adam;
pub mod constants;
pub mod covariance_factor;
pub mod edit;
pub mod effects;
pub mod error;
pub mod examination;
pub mod image;
pub mod loss;
pub mod memory;
pub mod metrics;
pub mod noise;
pub mod perspective;
pub mod profile;
pub mod rasterizer;
pub mod scene;
pub mod settings;
pub mod sh;
pub mod splat;
pub mod state;
pub mod statistics;
pub mod target;
pub mod view;
pub mod whitened;
mod words;

pub use crate::{
    adam::{Adam, AdamRates, Parameterization, Participants, Penalty},
    edit::EditPlan,
    effects::{Blend, Effects},
    error::Error,
    image::Image,
    loss::Loss,
    noise::MeanNoise,
    rasterizer::{Backend, Binning, Optimizer, Rasterizer, TrainStep, Wait},
    scene::{Gaussian2d, Gaussian3d, Scene, Scene2d, Scene3d},
    settings::{Accuracy, RenderSettings},
    state::SplatsState,
    statistics::DensityStatistics,
    target::TargetImage,
    view::{Camera, Canvas},
    words::counted,
};
