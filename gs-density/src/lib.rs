//! Density control: which Gaussians grow, which are pruned, and what is done to them.
//!
//! A policy ([`DensityPolicy`]) is a struct of thresholds without hidden state: it looks at an [`Observation`] and returns an
//! [`EditPlan`](gs_core::EditPlan), which a backend applies. It knows no rasterizer.

// Guards are phrased so that NaN fails them: `!(x > 0.0)` is not `x <= 0.0`.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

mod observation;
mod residual;
pub mod seed;

pub use observation::{DensityPolicy, Observation, Residual, Rng};
pub use residual::ResidualGrowth;
