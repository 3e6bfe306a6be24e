//! The experiments by their names, and their chapters.

use std::fmt;

use super::Findings;

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
