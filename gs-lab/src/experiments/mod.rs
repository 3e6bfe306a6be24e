//! The experiments of the paper (§3 to §5.4, Figs. 6 to 9).
//!
//! [`Experiment::run`] performs an experiment on any backend. Its [`Findings`] contain the paper's
//! claims, each with a [`ClaimVerdict`] that is computed from its [`Circumstance`]s, and charts,
//! tables and pictures.
//!
//! All experiments but [`popping`] fit 2D scenes. Every fit has ordinary
//! [`FitSettings`](gs_train::FitSettings) and is deterministic for a given seed.

#[cfg(test)]
mod as_studies;
#[cfg(test)]
mod claims;
mod cold_start;
mod edges;
mod files;
mod findings;
mod instability;
mod laboratory;
mod lazy_convergence;
mod page;
mod paired;
pub mod popping;
mod set_up;
mod textbook;

use std::fmt;

use gs_core::{Optimizer, Scene2d, Scene3d};

pub(crate) use self::paired::Paired;
pub use self::{
    files::{ResultFile, claims_csv},
    findings::{Cell, Circumstance, Claim, ClaimVerdict, Findings, Number, Picture, Table},
    laboratory::{ExperimentSize, Laboratory, Watch},
    page::{PageSetting, page},
};
use gs_train::Error;

/// The PSNR from which on a reconstruction of the paper's target counts as sharp, dB. Its root mean
/// square error is then 1.8 % of the range; that of 20 Gaussians without growth is 8 %.
pub(crate) const SHARP_DB: f64 = 35.0;

/// An experiment, in the paper's order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Experiment {
    /// 20 large Gaussians become 600, and the value of growth.
    SetUp,
    /// Small Gaussians along the border.
    ColdStart,
    /// The absolute threshold and other criteria of growth.
    LazyConvergence,
    /// A scale that goes to zero.
    Instability,
    /// Positions and shapes of the Gaussians of the result.
    Edges,
    /// Sort orders with a moving camera, in 3D.
    Popping,
}

impl Experiment {
    /// All experiments.
    pub const ALL: [Self; 6] =
        [Self::SetUp, Self::ColdStart, Self::LazyConvergence, Self::Instability, Self::Edges, Self::Popping];

    /// The experiment's name, in kebab-case.
    pub const fn name(self) -> &'static str {
        match self {
            Self::SetUp => "set-up",
            Self::ColdStart => "cold-start",
            Self::LazyConvergence => "lazy-convergence",
            Self::Instability => "instability",
            Self::Edges => "edges",
            Self::Popping => "popping",
        }
    }

    /// The experiment's title.
    pub const fn title(self) -> &'static str {
        match self {
            Self::SetUp => "Set-up and result",
            Self::ColdStart => "Cold start",
            Self::LazyConvergence => "Lazy convergence",
            Self::Instability => "Numerical instability",
            Self::Edges => "Edges against blobs",
            Self::Popping => "Sorting artefacts",
        }
    }

    /// The sections and figures of the paper that the experiment repeats.
    pub const fn section(self) -> &'static str {
        match self {
            Self::SetUp => "§3.1–3.3, Figs. 6, 7, 8",
            Self::ColdStart => "§3.4.1, §5.1, Fig. 9 top",
            Self::LazyConvergence => "§3.4.3, §5.2, Fig. 9 bottom",
            Self::Instability => "§3.4.2",
            Self::Edges => "§3.3, Fig. 7",
            Self::Popping => "§5.4, §2.3.1",
        }
    }

    /// The experiment of that name.
    ///
    /// # Errors
    /// [`gs_core::Error::Setting`], listing the names.
    pub fn from_name(name: &str) -> Result<Self, gs_core::Error> {
        let allowed = "one of set-up, cold-start, lazy-convergence, instability, edges, popping";
        let found = Self::ALL.into_iter().find(|experiment| experiment.name() == name);
        found.ok_or_else(|| gs_core::Error::setting("the experiment", format!("`{name}`"), allowed))
    }

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

/// An experiment with its findings.
#[derive(Debug, Clone, PartialEq)]
pub struct Chapter {
    /// The experiment.
    pub experiment: Experiment,
    /// The experiment's findings.
    pub findings: Findings,
}

impl fmt::Display for Experiment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_found_and_the_error_lists_them() {
        let message = Experiment::from_name("cold-strat").unwrap_err().to_string();
        for experiment in Experiment::ALL {
            assert_eq!(Experiment::from_name(experiment.name()).unwrap(), experiment);
            assert!(message.contains(experiment.name()), "{message}");
        }
    }
}
