//! The experiments of the paper (§3 to §5.4, Figs. 6 to 9), each as a function that measures and a type that holds what came out.
//!
//! [`Experiment::run`] makes one of them, whatever the backend, and gives its [`Findings`]: the paper's claims in other words, each with
//! the [`Circumstance`]s that have to hold for it and how often they do, of which its [`Verdict`] is a function, beside charts, tables and
//! pictures. Who wants the numbers themselves calls the experiment's own function, such as [`cold_start::measure`].
//!
//! All but [`popping`] fit 2D scenes. Every fit is an ordinary [`FitSettings`](gs_train::FitSettings) value; all of them are deterministic by their seeds.

pub mod cold_start;
pub mod edges;
mod files;
mod findings;
pub mod instability;
mod laboratory;
pub mod lazy_convergence;
mod page;
mod paired;
pub mod popping;
pub mod set_up;
mod textbook;

use std::fmt;

use gs_core::{Optimizer, Scene2d, Scene3d};

pub use self::{
    files::{ResultFile, claims_csv},
    findings::{Cell, Circumstance, Claim, Findings, Number, Picture, Table, Verdict},
    laboratory::{Extent, Laboratory, Watch},
    page::{PageSetting, page},
    paired::Paired,
};
use gs_train::Error;

/// A reconstruction of the paper's target is called sharp from this PSNR on, dB: its root mean square error is then 1.8 % of the range,
/// while 20 Gaussians that stay 20, the paper's blurry blobs, leave 8 %.
pub const SHARP_DB: f64 = 35.0;

/// The experiments, in the paper's order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Experiment {
    /// 20 large Gaussians become 600, and what growth is worth: [`set_up`].
    SetUp,
    /// Small Gaussians on the periphery: [`cold_start`].
    ColdStart,
    /// The absolute threshold and its rivals: [`lazy_convergence`].
    LazyConvergence,
    /// A scale that is driven towards zero: [`instability`].
    Instability,
    /// Where the Gaussians of the result stand, and how they are shaped: [`edges`].
    Edges,
    /// Orders of blending before a moving camera, in 3D: [`popping`].
    Popping,
}

impl Experiment {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::SetUp, Self::ColdStart, Self::LazyConvergence, Self::Instability, Self::Edges, Self::Popping];

    /// Its name, in kebab-case.
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

    /// Its title.
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

    /// What of the paper it repeats.
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

    /// Makes the experiment.
    ///
    /// # Errors
    /// Those of the backend, and [`Error::Diverged`] where a fit of the product does that; [`instability`] counts those instead.
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

/// An experiment with what came out of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Chapter {
    /// Which it is.
    pub experiment: Experiment,
    /// What came out.
    pub findings: Findings,
}

impl fmt::Display for Experiment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A claim of the paper that no experiment here tests.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Elsewhere {
    /// Its title.
    pub title: &'static str,
    /// Where the paper makes it.
    pub section: &'static str,
    /// What the paper says, in other words.
    pub statement: &'static str,
    /// What measures it instead.
    pub by: &'static str,
}

/// What benchmarks measure: it is of the machine and the build as much as of the method.
pub const ELSEWHERE: [Elsewhere; 1] = [Elsewhere {
    title: "Memory and storage",
    section: "§5.3",
    statement: "Trained scenes of millions of Gaussians take gigabytes on disk and more than 20 GB of memory while they are trained.",
    by: "Measured by the benchmarks of gs-lab: `formats`, bytes a Gaussian on disk in every format, and `memory`, the peak of memory in \
         training by Gaussians, tile entries and pixels. Their records stand under benchmarks/.",
}];

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
