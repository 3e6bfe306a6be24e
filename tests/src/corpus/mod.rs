//! A named corpus of hard cases that any backend can be put through: NaN losses, illegal accesses and silent corruption are what engines of
//! this field are most often reported for.
//!
//! Each [`Case`] says why it is hard, who met it before, and what must come of it: an exact outcome, agreement with the oracle within the
//! roundings that its analysis of this very scene allows, or a typed error. It runs forward, backward and through training, in every chart.
//! `cargo run -p gs-conformance --example corpus` prints the table for the backends of this repository; another backend's tests do:
//!
//! ```
//! use gs_conformance::corpus::{Record, planar_corpus, run};
//! use gs_core::{PlanarScene, Rasterizer};
//!
//! fn my_backend_stands_hard_cases(backend: &impl Rasterizer<PlanarScene>) {
//!     for case in planar_corpus() {
//!         let record = run(backend, &case);
//!         assert!(record.is_as_expected(), "{record}");
//!     }
//! }
//! ```

mod case;
mod differences;
mod hardship;
mod planar;
mod poison;
mod report;
mod run;
mod spatial;

pub use self::{
    case::{Case, Drawn, Expected, Goal, NEGLIGIBLE, Picture, STEPS, Slopes, Source, Training},
    differences::{BACKEND_SHARE, Differences, ILL_CONDITIONED_SHARE, ORACLE_SHARE, Quotients},
    hardship::{Hardship, hard_planar, hard_spatial},
    planar::planar_corpus,
    poison::{
        Breadth, Inputs, Offered, Slot, VALUES, poison_planar, poison_planar_slots, poison_spatial,
        poison_spatial_slots,
    },
    report::{Observed, Record},
    run::run,
    spatial::spatial_corpus,
};
