//! The price of accuracy: every approximation of a rendering is a setting, and its cost in time and
//! error is measured on the given scene, views and machine.
//!
//! A [`Field`] is a scene on several [`Contender`](super::Contender)s: backends, instruction sets and configurations.
//! [`search`] measures every setting alone, predicts which combinations lie on the frontier, and
//! measures those: their times, and their errors against the 64-bit oracle. Measurements are
//! interleaved, after a warm-up. Each backend's default is measured twice, as if it were two
//! settings; their difference is the noise below which nothing counts as faster
//! ([`Noise`](super::Noise)).
//! [`Budget::choose`] picks the cheapest settings that are exact enough, and verifies them on views
//! that the search has not used. [`FrontierSettings`] are those settings in a file.
//!
//! The exact picture has the effects of the default settings and no cut-offs: no α cut, no early
//!   stop at full pixels. Other sort orders, other antialiasing and fewer SH coefficients make
//!   other pictures; their errors are the differences from the exact one.
//!
//! `Binning::Reuse` is left out: it is an approximation of training steps, not of a picture.

mod budget;
mod field;
mod outcome;
mod pareto;
mod predict;
mod setting;
mod settings_file;
#[cfg(test)]
mod tests;

pub use self::{
    budget::{Budget, Choice, Missed, Verification},
    field::{Field, SearchLimits, search},
    outcome::{Frontier, Measured},
    settings_file::{FrontierEffects, FrontierMachine, FrontierSettings},
};
pub(crate) use self::{outcome::Role, setting::Change};
