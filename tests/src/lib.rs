//! The 64-bit oracle and the conformance suite that any [`Rasterizer`](gs_core::Rasterizer) can be put through.
//!
//! A new backend's tests call [`conformance::conformance`]. What it compares with is [`Oracle`](oracle::Oracle); how near the two must come is
//! in [`tolerance`]; what is drawn is in [`scenes`]. Tests on real photographs and scenes find them by [`data`].
//! What fuzzers draw, and what a backend owes even that, is in [`fuzzed`]; hard cases are in [`corpus`]. What property tests share
//! is in [`properties`].

// Guards are phrased so that NaN fails them: `!(x > 0.0)` is not `x <= 0.0`.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

pub mod bits;
pub mod conformance;
pub mod corpus;
pub mod data;
pub mod failure;
pub mod fuzzed;
pub mod properties;
pub mod scenes;
pub mod subject;
pub mod tolerance;

pub use gs_oracle as oracle;

pub use crate::failure::Failure;
