//! The arithmetic that every backend computes, written plainly: one Gaussian through a camera, and
//! its derivatives.

pub mod packed_moments;
pub mod perspective;
pub mod sh;
pub mod similarity;
pub mod whitened;

pub use crate::{image::completed, training::random_words};
