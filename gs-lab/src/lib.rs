#![doc = include_str!("../README.md")]
//! # Start reading at
//!
//! - A [`Study`] is arms × images or 3D scenes × budgets × seeds, from a short TOML file.
//! - A [`Plan`] turns it into runs, each with an address that follows from everything its result
//!   depends on.
//! - [`conduct`] does the runs that are missing, side by side, and stores each as one file. Any
//!   number of processes may do so in one folder; each claims its runs.
//! - [`Results`] makes tables with intervals and judges the claims of the study, [`report`] makes a
//!   page. Programs read the numbers from the files of [`report::write`]: each table is a CSV file.
//! - [`blocks`] trains a large scene in parts that are jobs, too.
//! - [`price`] measures what approximations cost, and [`experiments`] names the studies of the paper
//!   and makes their page.
//!
//! Each module uses only those before it in this list: [`study`], [`run`], `result`, [`report`],
//! [`price`], [`experiments`]. [`blocks`] uses [`study`] and [`run`] only.

pub mod blocks;
mod error;
pub mod experiments;
pub mod price;
pub mod report;
mod result;
pub mod run;
#[cfg(test)]
mod sources;
pub mod study;
mod synthetic;
#[cfg(test)]
mod tests;

pub use crate::{
    error::Error,
    result::Results,
    run::{Existing, StudyFolder, conduct},
    study::{Places, Plan, Study, built_in},
};
