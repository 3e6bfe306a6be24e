#![doc = include_str!("../README.md")]
//! # Start reading at
//!
//! - A [`Study`] is arms × images or 3D scenes × budgets × seeds, from a short TOML file.
//! - A [`Plan`] turns it into runs, each with an address that follows from everything its result
//!   depends on.
//! - [`conduct`] does the runs that are missing, side by side, and stores each as one file. Any
//!   number of processes may do so in one folder; each claims its runs.
//! - [`Results`] makes tables with intervals, [`report`] a page.
//! - [`experiments`], [`frontier`], [`effects`], [`compression`] and [`figure`] hold the rest.

mod arm;
mod built_in;
mod claims;
mod clock;
mod comparison;
pub mod compression;
mod conduct;
mod contrast;
mod dataset_reading;
mod digest;
pub mod effects;
mod error;
pub mod experiments;
mod export;
mod factor;
mod factorial;
pub mod figure;
mod folder;
pub mod frontier;
mod html;
mod job_files;
mod key_lines;
mod locked_results;
mod machine;
mod origin;
pub mod overrides;
mod plan;
mod queue;
mod reach;
mod record;
mod recorded;
mod remark;
mod replay;
pub mod report;
mod result_names;
mod resumption;
mod run_files;
mod run_store;
mod selection;
mod settings;
pub mod slurm;
#[cfg(test)]
mod sources;
mod statistics;
pub mod study;
mod synthetic;
mod system;
mod tables;
mod target;
mod task;
mod text_tables;
mod train;
mod trajectory;
mod verdict;
mod watcher;
mod work;

pub use crate::{
    built_in::built_in,
    conduct::{conduct, conduct_with},
    error::Error,
    folder::{Existing, StudyFolder},
    plan::Plan,
    study::Study,
    tables::Results,
    target::Places,
};
