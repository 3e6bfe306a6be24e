//! What accuracy costs in time: every approximation of a rendering is a setting, and here each has its price, on the scene, the views and the
//! machine at hand.
//!
//! A [`Field`] is the scene on several [`Contender`]s: backends, instruction sets, ways of going about the work. [`search`] measures every
//! [`Setting`] alone, predicts from that which combinations lie on the frontier, measures those, and says of each how long it takes and how far
//! its picture is from the 64-bit oracle's ([`Truth`]). Runs are interleaved, after a warm-up; each backend's default is measured twice as if it
//! were two settings, and what those differ by is the noise within which nothing is called faster ([`Noise`]). [`Budget::choose`] picks the
//! cheapest settings that are exact enough, and holds them against views that the search has not seen.
//!
//! *What is exact* is the picture with the effects that the caller shows the scene with, without cut-offs: no cut of α, no full pixels.
//! Other orders, other antialiasing and fewer SH coefficients are other pictures; they are priced by how much they differ from it.
//!
//! Left out: `Binning::Reuse`, which is an approximation of training steps and not of a picture, and
//! what `gs_cpu::CpuTuning` says has no variant.

mod budget;
mod contender;
mod export;
mod field;
mod noise;
mod outcome;
mod pareto;
mod picture_error;
mod predict;
mod setting;
mod timing;
mod truth;

pub use self::{
    budget::{Budget, Choice, Chosen, Verification},
    contender::{Contender, Loaded, Renderer},
    export::{figure, to_csv, to_text},
    field::{Field, Pace, search},
    noise::{Comparison, Noise},
    outcome::{Frontier, Measured, Role},
    pareto::frontier_of,
    picture_error::PictureError,
    setting::{Change, Setting, alternatives},
    truth::{Truth, Verifiable},
};
