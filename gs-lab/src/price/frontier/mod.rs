//! What accuracy costs in time: every approximation of a rendering is a setting, and its time and
//! its error are measured on the given scene, views and machine.
//!
//! A `Sweep` is a scene on several candidates: backends, instruction sets and configurations.
//! [`Search::run`] measures every setting alone: its time, and its error against the 64-bit oracle. Measurements are
//! interleaved, after a warm-up. Each backend's default is measured twice, as if it were two
//! settings. Differences in time below the difference of these two are noise. For a [`Budget`], the
//! search picks the fastest settings that are exact enough, or the most exact that are fast enough,
//! and verifies them on views that it has not used.
//!
//! The reference picture has the effects of the default settings and no cut-offs: no α cut, no
//! early stop at full pixels. Other sort orders, other antialiasing and fewer SH coefficients
//! change the picture; their error is the difference from the reference.
//!
//! `Binning::Reuse` is not measured: it is an approximation of training steps, not of a picture.

mod answer;
mod budget;
mod outcome;
mod pareto;
mod setting;
mod sweep;
#[cfg(test)]
mod tests;

use std::fmt;

use gs_backend::AnyRasterizer;
use gs_core::{Optimizer, RenderSettings, Scene, counted};
use serde::{Serialize, Serializer};

use self::{
    answer::Answer,
    outcome::{Frontier, Measured, Role},
    sweep::{Sweep, search},
};
use super::{machine::candidates, reference::Verifiable};
use crate::error::Error;

pub use self::budget::Budget;
pub(crate) use self::setting::Change;

/// Share of the time for timing that verification takes.
const VERIFYING: f64 = 0.1;

/// A search for the frontier of a scene.
#[derive(Debug)]
pub struct Search<'a, S: Scene> {
    /// The scene, and what it is in words.
    pub scene: (&'a S, &'a str),
    /// A rasterizer of each backend. Other configurations of the backend are candidates, too.
    pub backends: Vec<AnyRasterizer>,
    /// The default settings of all backends. Their effects define the reference picture.
    pub shown: RenderSettings,
    /// The views of the search.
    pub views: &'a [S::View],
    /// The views that verify its answer.
    pub unseen: &'a [S::View],
    /// Seconds for timing. At least seven rounds are measured, however long they take.
    pub seconds: f64,
    /// The largest error or time of the settings to find; `None` for the frontier alone.
    pub budget: Option<Budget>,
}

impl<S: Verifiable> Search<'_, S>
where
    AnyRasterizer: Optimizer<S>,
{
    /// Measures every setting alone, on every backend, and finds one for the budget. Reports its progress to `watch`.
    ///
    /// # Errors
    /// Those of the backends, and of the oracle for effects that it does not have;
    /// [`gs_core::Error::Setting`] without a view or a backend. An error of the verification, after
    /// all measurements, is [`FrontierReport::failure`] instead.
    pub fn run(self, watch: &mut dyn FnMut(&str)) -> Result<FrontierReport, Error> {
        let Self { scene: (scene, what), backends, shown, views, unseen, seconds, budget } = self;
        let mut all = Vec::new();
        for base in backends {
            all.extend(candidates(base, scene)?);
        }
        let sweep = Sweep { scene, candidates: all, shown };
        let frontier = search(&sweep, views, seconds, watch)?;
        let (mut answer, mut missed, mut failure) = (None, None, None);
        if let Some(budget) = budget {
            let others = counted(unseen.len(), "view");
            watch(&format!("verifying on {others} that the search did not use"));
            match budget.choose(&sweep, &frontier, unseen, VERIFYING * seconds) {
                Ok(Ok(choice)) => answer = Some(Answer::new(budget, choice, &sweep, &frontier, what)),
                Ok(Err(why)) => missed = Some(answer::missed(budget, why, unseen.len())),
                Err(error) => failure = Some(error.into()),
            }
        }
        Ok(FrontierReport { frontier, answer, missed, failure })
    }
}

/// The frontier of a scene, and settings that keep a budget.
#[derive(Debug, Serialize)]
#[non_exhaustive]
pub struct FrontierReport {
    #[serde(flatten)]
    frontier: Frontier,
    #[serde(skip_serializing_if = "Option::is_none")]
    answer: Option<Answer>,
    /// Why no settings keep the budget, and what helps besides a larger budget.
    #[serde(skip)]
    pub missed: Option<(String, &'static str)>,
    /// Why settings for the budget could not be verified. The measurements are complete.
    #[serde(skip_serializing_if = "Option::is_none", serialize_with = "as_message")]
    pub failure: Option<Error>,
}

fn as_message<S: Serializer>(failure: &Option<Error>, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(&failure.iter().map(Error::to_string).collect::<String>())
}

impl FrontierReport {
    /// The table as CSV.
    pub fn csv(&self) -> String {
        self.frontier.table().csv()
    }

    /// The figure of error against time, as SVG.
    pub fn figure(&self, title: &str) -> String {
        self.frontier.figure(title).svg_file()
    }

    /// The flags of `gs render` for the settings that keep the budget, below comments with what was measured.
    pub fn answer(&self) -> Option<&str> {
        Some(&self.answer.as_ref()?.text)
    }
}

/// The table, followed by notes on noise, errors and refused settings.
impl fmt::Display for FrontierReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.frontier.text())
    }
}
