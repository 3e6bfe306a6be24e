//! The 64-bit oracle and the conformance suite that any [`Rasterizer`](gs_core::Rasterizer) of planar scenes can be put through.

// Guards are phrased so that NaN fails them: `!(x > 0.0)` is not `x <= 0.0`.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

pub mod failure;
pub mod oracle;
pub mod scenes;
pub mod tolerance;

pub use crate::failure::Failure;
