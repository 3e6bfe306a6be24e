//! The experiments of the paper (§3 to §5.4, Figs. 6 to 9).
//!
//! An [`Experiment`] is one or several [studies](Experiment::studies) that come with the program,
//! whose files hold the paper's claims. What no study can express, [`Experiment::begin`] measures: a
//! camera flight in 3D. [`page()`] compares all claims with what was measured.

mod page;
mod popping;

use gs_backend::AnyRasterizer;
use gs_core::counted;

pub use self::page::page;
use crate::{
    error::Error,
    report::{self, Findings},
    result::{Results, claims_csv as csv_of_claims, verdicts as count_verdicts},
    run::StudyFolder,
    study::{Study, built_in},
};

/// Measures what no study can express, in a quick form or in full. Lines about the progress go to the
/// function.
type Measurement = fn(&AnyRasterizer, bool, &dyn Fn(&str)) -> Result<Findings, gs_train::Error>;

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
    measurement: Option<Measurement>,
}

/// All experiments, in the paper's order.
pub static EXPERIMENTS: [Experiment; 6] = [
    Experiment {
        name: "set-up",
        title: "Set-up and result",
        section: "§3.1–3.3, Figs. 6, 7, 8",
        studies: &["set-up"],
        measurement: None,
    },
    Experiment {
        name: "cold-start",
        title: "Cold start",
        section: "§3.4.1, §5.1, Fig. 9 top",
        studies: &["cold-start"],
        measurement: None,
    },
    Experiment {
        name: "lazy-convergence",
        title: "Lazy convergence",
        section: "§3.4.3, §5.2, Fig. 9 bottom",
        studies: &["lazy-convergence", "thresholds"],
        measurement: None,
    },
    Experiment {
        name: "instability",
        title: "Numerical instability",
        section: "§3.4.2",
        studies: &["instability"],
        measurement: None,
    },
    Experiment {
        name: "edges",
        title: "Edges against blobs",
        section: "§3.3, Fig. 7",
        studies: &["edges"],
        measurement: None,
    },
    Experiment {
        name: "popping",
        title: "Sorting artefacts",
        section: "§5.4, §2.3.1",
        studies: &[],
        measurement: Some(popping::measure),
    },
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

    /// Measures what the experiment has besides its [studies](Self::studies). Lines about the progress go
    /// to `note`.
    ///
    /// # Errors
    /// Those of the backend. Fits that diverge are counted instead.
    pub fn begin(&'static self, on: &AnyRasterizer, quick: bool, note: &dyn Fn(&str)) -> Result<Chapter, Error> {
        let measured = self.measurement.map(|measure| measure(on, quick, note)).transpose()?;
        Ok(Chapter { experiment: self, findings: measured.unwrap_or_default(), excerpts: Vec::new() })
    }
}

/// An experiment with its findings.
#[derive(Debug)]
pub struct Chapter {
    experiment: &'static Experiment,
    /// The claims of its studies, and what it measures besides.
    findings: Findings,
    /// Name, and tables, curves and pictures as HTML, of each of its studies.
    excerpts: Vec<(String, String)>,
}

impl Chapter {
    /// Names and contents of the files of what was measured so far: see [`Findings::files`].
    pub fn files(&self) -> Vec<(String, Vec<u8>)> {
        self.findings.files(&format!("{}/", self.experiment.name))
    }

    /// Adds a study of the experiment with its claims.
    ///
    /// # Errors
    /// [`Error::Picture`] where something cannot be drawn.
    pub fn add(&mut self, results: &Results<'_>, folder: &StudyFolder) -> Result<(), Error> {
        let study = &results.plan.study;
        let method = format!("{} ({}).", study.question, counted(results.plan.runs.len(), "run"));
        self.findings.add(Findings { method, claims: results.claims(), ..Findings::default() });
        self.excerpts.push((study.name.clone(), report::excerpt(results, folder)?));
        Ok(())
    }
}

/// "3 claims: 2 confirmed, 1 partly".
pub fn verdicts(chapters: &[Chapter]) -> String {
    count_verdicts(chapters.iter().flat_map(|chapter| &chapter.findings.claims))
}

/// All claims with their verdicts as CSV.
pub fn claims_csv(chapters: &[Chapter]) -> String {
    csv_of_claims(chapters.iter().map(|chapter| (chapter.experiment.name, chapter.findings.claims.as_slice())))
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
