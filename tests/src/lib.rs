#![doc = include_str!("../README.md")]
//! # Start reading at
//!
//! [`conformance`] has the cases, [`tolerance`] says how near a backend must come to the
//! [`oracle`], [`scenes`] draws what is compared. Hard cases are in [`corpus`], and what a backend
//! owes to random scenes in [`fuzzed`]. Tests on real images find them through [`data`], and [`posed`]
//! writes small data sets of posed images.

// Guards are phrased so that NaN fails them: `!(x > 0.0)` is not `x <= 0.0`.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

/// Makes the examples of the README compile.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
struct Readme;

pub mod adam_reference;
pub mod bits;
pub mod conformance;
pub mod corpus;
pub mod data;
pub mod failure;
pub mod fuzzed;
pub mod posed;
pub mod properties;
pub mod scenes;
pub mod subject;
pub mod tolerance;

pub use gs_oracle as oracle;

pub use crate::failure::Failure;
