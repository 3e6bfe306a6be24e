//! The experiments of the paper (§3 to §5.4, Figs. 6 to 9).
//!
//! [`Experiment::run`] performs an experiment on any backend. Its [`Findings`] contain the paper's
//! claims, each with a [`ClaimVerdict`] that is computed from its [`Circumstance`]s, and charts,
//! tables and pictures.
//!
//! All experiments but [`Experiment::Popping`] fit 2D scenes. Every fit has ordinary
//! [`FitSettings`](gs_train::FitSettings) and is deterministic for a given seed.

#[cfg(test)]
mod as_studies;
#[cfg(test)]
mod claims;
mod cold_start;
mod edges;
mod experiment;
mod files;
mod findings;
mod instability;
mod laboratory;
mod lazy_convergence;
mod page;
mod paired;
mod popping;
mod set_up;

use gs_core::{Optimizer, Scene2d, Scene3d};

pub(crate) use self::paired::Paired;
pub use self::{
    experiment::{Chapter, Experiment},
    files::{ResultFile, claims_csv},
    findings::{Cell, Circumstance, Claim, ClaimVerdict, Findings, Number, Picture, Table},
    laboratory::{ExperimentSize, Laboratory, Watch},
    page::{PageSetting, page},
};
use gs_train::Error;

impl Experiment {
    /// Performs the experiment.
    ///
    /// # Errors
    /// Those of the backend, and [`Error::Diverged`] where a fit diverges. [`Self::Instability`]
    /// counts diverging fits instead.
    pub fn run<R: Optimizer<Scene2d> + Optimizer<Scene3d>>(
        self,
        laboratory: &mut Laboratory<'_, R>,
    ) -> Result<Findings, Error> {
        match self {
            Self::SetUp => Ok(set_up::measure(laboratory)?.findings()),
            Self::ColdStart => Ok(cold_start::measure(laboratory)?.findings()),
            Self::LazyConvergence => Ok(lazy_convergence::measure(laboratory)?.findings()),
            Self::Instability => Ok(instability::measure(laboratory)?.findings()),
            Self::Edges => Ok(edges::measure(laboratory)?.findings()),
            Self::Popping => Ok(popping::measure(laboratory)?.findings()),
        }
    }
}
