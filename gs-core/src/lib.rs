#![doc = include_str!("../README.md")]
//! # Start reading at
//!
//! - [`Rasterizer`] draws scenes and differentiates their images; [`Optimizer`] trains where the
//!   backend computes.
//! - [`Scene2d`] and [`Scene3d`] are scenes, [`Canvas`] and [`Camera`] their views.
//! - The module `splat` blends a Gaussian at a pixel, `perspective` projects a 3D Gaussian.
//! - [`constants`] has every number that backends must agree on.

// Guards are phrased so that NaN fails them: `!(x > 0.0)` is not `x <= 0.0`.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

pub mod constants;
pub mod effects;
mod error;
pub mod examination;
mod image;
pub mod math;
pub mod memory;
pub mod metrics;
pub mod profile;
mod rasterizer;
mod scene;
mod settings;
mod state;
mod training;
pub mod view;
mod words;

pub use self::training::{adam, edit};
pub use crate::{
    adam::{Adam, AdamRates, MomentFormat, Parameterization, Participants, Penalty},
    edit::EditPlan,
    effects::{Blend, Effects},
    error::Error,
    image::{Image, TargetImage, check_same_size, check_size, rounded_to_8_bits, to_8_bits},
    rasterizer::{Backend, Binning, Optimizer, Rasterizer, TrainStep, Wait},
    scene::{
        Bounds, Gaussian2d, Gaussian3d, LodCut, LodLevel, LodNode, Region, Scene, Scene2d, Scene3d, check_len, logit,
        sigmoid,
    },
    settings::{Accuracy, Choice, Cut, Dropout, Output, RenderSettings},
    state::{SavedState, SavedTensor, SplatsState, Tensor, TensorData, TensorType},
    training::{CullCause, Culled, DensityStatistics, Loss, MeanNoise},
    view::{Camera, CameraGradient, Canvas},
    words::{counted, duration},
};
