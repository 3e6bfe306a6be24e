//! The experiments of the paper (§3 to §5.2, Figs. 6 to 9).
//!
//! An [`Experiment`] is one or several [studies](Experiment::studies) that come with the program,
//! whose files hold the paper's claims. [`page()`] compares all claims with what was measured.

mod page;

use gs_core::counted;

pub use self::page::page;
use crate::{
    error::Error,
    result::{Claim, Results, claims_csv as csv_of_claims, verdicts as count_verdicts},
    study::{Study, built_in},
};

/// An experiment of the paper.
#[derive(Debug)]
#[non_exhaustive]
pub struct Experiment {
    /// The experiment's name, in kebab-case.
    pub name: &'static str,
    title: &'static str,
    /// The sections and figures of the paper that the experiment repeats.
    section: &'static str,
    /// The names of its studies.
    studies: &'static [&'static str],
}

/// All experiments, in the paper's order.
pub static EXPERIMENTS: [Experiment; 5] = [
    Experiment {
        name: "set-up", title: "Set-up and result", section: "§3.1–3.3, Figs. 6, 7, 8", studies: &["set-up"]
    },
    Experiment {
        name: "cold-start",
        title: "Cold start",
        section: "§3.4.1, §5.1, Fig. 9 top",
        studies: &["cold-start"],
    },
    Experiment {
        name: "lazy-convergence",
        title: "Lazy convergence",
        section: "§3.4.3, §5.2, Fig. 9 bottom",
        studies: &["lazy-convergence", "thresholds"],
    },
    Experiment { name: "instability", title: "Numerical instability", section: "§3.4.2", studies: &["instability"] },
    Experiment { name: "edges", title: "Edges against blobs", section: "§3.3, Fig. 7", studies: &["edges"] },
];

impl Experiment {
    /// The studies with the experiment's fits and claims, in their full or quick form; each has a folder of
    /// its own.
    ///
    /// # Errors
    /// Those of a study that is not possible.
    pub fn studies(&self, quick: bool) -> Result<Vec<Study>, Error> {
        let of_size = |name: &&str| if quick { built_in(name)?.quick() } else { built_in(name) };
        self.studies.iter().map(of_size).collect()
    }
}

/// An experiment with what its studies have found so far.
#[derive(Debug)]
pub struct Chapter {
    experiment: &'static Experiment,
    /// What each study asks, and how many runs it has.
    methods: Vec<String>,
    /// The claims of all studies.
    claims: Vec<Claim>,
}

impl Chapter {
    /// An experiment before its first study.
    pub fn begun(experiment: &'static Experiment) -> Self {
        Self { experiment, methods: Vec::new(), claims: Vec::new() }
    }

    /// Adds a study of the experiment with its claims.
    pub fn add(&mut self, results: &Results<'_>) {
        self.methods.push(format!("{} ({}).", results.plan.study.question, counted(results.plan.runs.len(), "run")));
        self.claims.extend(results.claims());
    }
}

/// "3 claims: 2 confirmed, 1 partly".
pub fn verdicts(chapters: &[Chapter]) -> String {
    count_verdicts(chapters.iter().flat_map(|chapter| &chapter.claims))
}

/// All claims with their verdicts as CSV.
pub fn claims_csv(chapters: &[Chapter]) -> String {
    csv_of_claims(chapters.iter().map(|chapter| (chapter.experiment.name, chapter.claims.as_slice())))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::{Places, Plan};

    #[test]
    fn the_papers_studies_are_possible_in_both_forms_with_all_their_claims() {
        let places = Places::default();
        for experiment in &EXPERIMENTS {
            let [full, quick] = [false, true].map(|quick| experiment.studies(quick).unwrap());
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
