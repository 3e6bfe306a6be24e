//! The laboratory: everything that compares.
//!
//! - **Studies** say which settings or density policies are better, with numbers that survive review.
//!   A [`Study`] is arms × images × budgets × seeds, written in a short TOML file. A [`Plan`] lays it
//!   out into runs, each with an address that follows from all that its result depends on.
//!   [`conduct`] does the runs that are not done, side by side, and stores each as one file: killing
//!   it loses what was under way and nothing else. [`Results`] makes tables of them, with intervals,
//!   and [`report`] a page.
//! - The [`experiments`] repeat those of the paper, and set each claim beside what is measured.
//! - A [`frontier`] is the fastest settings for each accuracy of a picture.
//! - [`effects`] proves which effects a scene requires, and prices each.
//! - A [`figure`] is drawn as PNG and as SVG by the same code.
//!
//! All of it is generic over the backend. No library depends on this crate.
//!
//! A small study, from its text to its verdict:
//!
//! ```
//! use gs_cpu::{CpuRasterizer, CpuSettings};
//! use gs_lab::{Existing, Places, Plan, Results, Study, StudyFolder, conduct, report};
//!
//! let study = Study::from_toml(
//!     "name = 'growth'
//!      images = ['thin-lines-24px']
//!      budgets = [12]
//!      seeds = [0, 1]
//!      preset = 'paper'
//!      iterations = 20
//!      [[arm]]
//!      name = 'none'
//!      settings.policy.kind = 'none'
//!      [[arm]]
//!      name = 'percentile'
//!      settings.policy.kind = 'percentile'",
//!     "growth.toml",
//! )?;
//! let cpu = CpuRasterizer::new(CpuSettings::default())?;
//! let plan = Plan::new(study, &Places::default(), "cpu".to_owned())?;
//! let place = tempfile::tempdir()?;
//! let folder = StudyFolder::prepare(place.path(), &plan, Existing::Resume)?;
//! conduct(&plan, &[&cpu], &folder, &())?;
//! let results = Results::read(&plan, &folder);
//! report::headlines(&results).iter().for_each(|line| println!("{line}"));
//! assert_eq!(results.records.iter().flatten().count(), 4);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

/// Makes the examples of the README compile.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

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
mod statistics;
pub mod study;
mod synthetic;
mod tables;
mod target;

pub use crate::{
    built_in::built_in,
    conduct::conduct,
    error::Error,
    folder::{Existing, StudyFolder},
    plan::Plan,
    study::Study,
    tables::Results,
    target::Places,
};
