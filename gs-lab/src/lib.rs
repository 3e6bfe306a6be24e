#![doc = include_str!("../README.md")]
//! # Start reading at
//!
//! - A [`Study`] is arms × images × budgets × seeds, from a short TOML file.
//! - A [`Plan`] turns it into runs, each with an address that follows from everything its result
//!   depends on.
//! - [`conduct`] does the runs that are missing, side by side, and stores each as one file.
//! - [`Results`] makes tables with intervals, [`report`] a page.
//! - [`experiments`], [`frontier`], [`effects`] and [`figure`] hold the rest.

mod built_in;
mod comparison;
mod conduct;
mod digest;
pub mod effects;
mod error;
pub mod experiments;
mod export;
pub mod figure;
mod folder;
pub mod frontier;
mod html;
mod machine;
mod overrides;
mod plan;
mod reach;
mod record;
mod remark;
mod replay;
pub mod report;
mod selection;
#[cfg(test)]
mod sources;
pub mod statistics;
mod study;
mod synthetic;
mod tables;
mod target;

pub use crate::{
    built_in::{BUILT_IN, built_in},
    comparison::{Difference, EQUAL_COUNT, Verdict},
    conduct::{Conducted, Watcher, conduct, refuse_unsupported},
    digest::{of_image as image_digest, of_scene as scene_digest},
    error::Error,
    export::write_tables,
    folder::{Existing, Safety, StudyFolder},
    machine::Machine,
    plan::{Plan, Run, VERSION},
    record::{Finished, Outcome, Record},
    remark::{FEWEST_SEEDS, Pairing, Remark},
    replay::{Replayed, recorded_run, replay},
    selection::Selection,
    study::{Arm, Matching, OwnPolicy, Study},
    synthetic::SyntheticTarget,
    tables::{Metric, Quality, Results, Spread},
    target::{Places, Target},
};
