//! Studies: which density policy is better, on your images, with numbers that survive review.
//!
//! A [`Study`] is arms × images × budgets × seeds, written in a short TOML file; an arm is a set of settings, or a policy of the
//! caller's own. A [`Plan`] lays it out into runs, each with an address that follows from all that its result depends on.
//! [`conduct`] does the runs that are not done, side by side, and stores each as one file: whoever kills it loses what was under way and
//! nothing else. [`Results`] makes tables of them, with intervals, and [`report`] a page.

mod built_in;
mod conduct;
mod digest;
mod error;
mod export;
mod folder;
mod overrides;
mod plan;
mod record;
mod replay;
pub mod report;
pub mod statistics;
mod study;
mod tables;
mod target;

pub use crate::{
    built_in::{BUILT_IN, built_in},
    conduct::{Conducted, Watcher, conduct},
    digest::{of_image as image_digest, of_scene as scene_digest},
    error::Error,
    export::write_tables,
    folder::{Existing, StudyFolder},
    plan::{Plan, Run, VERSION},
    record::{Finished, Outcome, Record},
    replay::{Replayed, replay},
    study::{Arm, Matching, OwnPolicy, Study},
    tables::{Difference, EQUAL_COUNT, Metric, Pairing, Quality, Results, Spread},
    target::{Places, Target},
};
