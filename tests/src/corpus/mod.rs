//! A corpus of named hard cases for any backend. NaN losses, illegal accesses and silent corruption
//! are the most frequent reports about engines of this field.
//!
//! Each [`Case`] says why it is hard, where it is from, and what is expected: an exact result,
//! agreement with the oracle within the roundings of its analysis, or a typed error. It runs
//! forward, backward and through training, in every parameterization. `cargo run -p gs-conformance
//! --example corpus` prints the table for the backends of this repository; another backend's tests
//! do:
//!
//! ```
//! use gs_conformance::corpus::{Record, corpus_2d, run};
//! use gs_core::{Scene2d, Optimizer};
//!
//! fn my_backend_stands_hard_cases(backend: &impl Optimizer<Scene2d>) {
//!     for case in corpus_2d() {
//!         let record = run(backend, &case);
//!         assert!(record.is_as_expected(), "{record}");
//!     }
//! }
//! ```

mod case;
mod differences;
mod hardship;
mod poison;
mod report;
mod run;
mod scene2d;
mod scene3d;

pub use self::{
    case::{Case, Drawn, Expected, Goal, NEGLIGIBLE, Picture, STEPS, Slopes, Source, Training},
    differences::{BACKEND_SHARE, Differences, ILL_CONDITIONED_SHARE, ORACLE_SHARE, Quotients},
    hardship::{Hardship, hard_2d, hard_3d},
    poison::{Breadth, Inputs, Offered, Slot, VALUES, poison_2d, poison_3d, poison_slots_2d, poison_slots_3d},
    report::{Observed, Record},
    run::run,
    scene2d::corpus_2d,
    scene3d::corpus_3d,
};
