//! The arithmetic that every backend computes, written plainly: one Gaussian through a camera and
//! at one pixel, and the derivatives of both.

pub mod packed_moments;
pub mod perspective;
pub mod sh;
pub mod splat;
pub mod whitened;

pub use crate::{image::completed, training::random_words};
