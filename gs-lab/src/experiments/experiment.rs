//! The experiments by their names, and their chapters.

use std::fmt;

use gs_core::counted;

use super::Findings;
use crate::{
    error::Error,
    report::Excerpt,
    result::Results,
    study::{Study, built_in},
};

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

    /// The studies with the experiment's fits and claims, in their full or quick form.
    ///
    /// # Errors
    /// Those of a study that is not possible.
    pub fn studies(self, size: ExperimentSize) -> Result<Vec<Study>, Error> {
        let names: &[&str] = match self {
            Self::SetUp => &["set-up"],
            Self::ColdStart => &["cold-start"],
            Self::LazyConvergence => &["lazy-convergence", "thresholds"],
            Self::Instability => &["instability"],
            Self::Edges => &["edges"],
            Self::Popping => &[],
        };
        let of_size = |name: &&str| match size {
            ExperimentSize::Full => built_in(name),
            ExperimentSize::Quick => built_in(name)?.quick(),
        };
        names.iter().map(of_size).collect()
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

/// How much of an experiment runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum ExperimentSize {
    /// A full run: several seeds and all cases.
    #[default]
    Full,
    /// A quick run: fewer seeds, steps and cases.
    Quick,
}

impl ExperimentSize {
    /// Returns `full` or `quick`, according to the size.
    pub(crate) fn choose<T>(self, full: T, quick: T) -> T {
        match self {
            Self::Full => full,
            Self::Quick => quick,
        }
    }
}

/// An experiment with its findings.
#[derive(Debug, Clone, PartialEq)]
pub struct Chapter {
    /// The experiment.
    pub experiment: Experiment,
    /// The experiment's findings: the claims of its studies, and what it measures besides.
    pub findings: Findings,
    /// Tables, curves and pictures of its studies.
    pub excerpts: Vec<Excerpt>,
}

impl Chapter {
    /// A chapter without findings.
    pub fn new(experiment: Experiment) -> Self {
        Self { experiment, findings: Findings::default(), excerpts: Vec::new() }
    }

    /// Adds a study of the experiment with its claims.
    pub fn add(&mut self, results: &Results<'_>, excerpt: Excerpt) {
        let study = &results.plan.study;
        let runs = format!("{} ({}).", study.question, counted(results.plan.runs.len(), "run"));
        self.findings.add(Findings { method: runs, claims: results.claims(), ..Findings::default() });
        self.excerpts.push(excerpt);
    }
}

impl fmt::Display for Experiment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::{Places, Plan};

    #[test]
    fn names_are_found_and_the_error_lists_them() {
        let message = Experiment::from_name("cold-strat").unwrap_err().to_string();
        for experiment in Experiment::ALL {
            assert_eq!(Experiment::from_name(experiment.name()).unwrap(), experiment);
            assert!(message.contains(experiment.name()), "{message}");
        }
    }

    #[test]
    fn the_papers_studies_are_possible_in_both_forms_with_all_their_claims() {
        let places = Places::default();
        for experiment in Experiment::ALL {
            let [full, quick] =
                [ExperimentSize::Full, ExperimentSize::Quick].map(|size| experiment.studies(size).unwrap());
            for (full, quick) in full.into_iter().zip(quick) {
                let name = full.name.clone();
                assert!(!full.claims.is_empty() && full.claims.len() == quick.claims.len(), "{name}");
                let [full, quick] = [full, quick].map(|study| Plan::new(study, &places, "test").unwrap());
                let work = |plan: &Plan| plan.runs.iter().map(|run| plan.work(run)).sum::<f64>();
                assert!(work(&quick) < 0.6 * work(&full), "{name}: the quick form is hardly quicker");
            }
        }
    }
}
