//! The answer to a budget: a file of settings, with what it promises and how it did on other views.

use gs_core::{RenderSettings, profile::Quantiles};
use gs_study::frontier::{Budget, Choice, Frontier, Measured, Verification};
use serde::Serialize;

use crate::{
    chosen::{ChosenEffects, ChosenMachine, ChosenSettings},
    failure::Failure,
};

/// Settings that keep a budget.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct Answer {
    budget: Budget,
    /// What differs from the default, in words.
    settings: String,
    machine: String,
    #[serde(flatten)]
    choice: Choice,
    /// The file of settings.
    #[serde(skip)]
    pub(crate) file: String,
}

impl Answer {
    /// The answer for `what`; effects are written for scenes in space only.
    ///
    /// # Errors
    /// Where the settings cannot be written as TOML.
    pub(crate) fn new(
        budget: Budget,
        choice: &Choice,
        frontier: &Frontier,
        machines: &[ChosenMachine],
        what: &str,
        in_space: bool,
    ) -> Result<Self, Failure> {
        let row = &frontier.rows[choice.row];
        let RenderSettings { accuracy, effects, .. } = row.settings;
        let shown = ChosenEffects { order: effects.order, antialias: effects.antialias, sh_degree: effects.sh_degree };
        let settings =
            ChosenSettings { accuracy, effects: in_space.then_some(shown), machine: machines[row.contender].clone() };
        let file = settings.to_file(&comment(budget, choice, row, what))?;
        Ok(Self { budget, settings: row.name(), machine: row.machine.clone(), choice: choice.clone(), file })
    }
}

/// Why nothing is chosen.
pub(crate) fn out_of_reach(budget: Budget, best: f64) -> Failure {
    let (message, flag) = match budget {
        Budget::MaxError(most) => {
            (format!("--max-error {most}: the most exact settings are off by {best:.1e}"), "--max-error")
        }
        Budget::MaxSeconds(most) => {
            (format!("--max-ms {}: the quickest settings take {:.3} ms", 1e3 * most, 1e3 * best), "--max-ms")
        }
    };
    Failure::failed(message).mend(format_args!("give a larger {flag}, or leave a margin for other views"))
}

fn comment(budget: Budget, choice: &Choice, row: &Measured, what: &str) -> String {
    let asked = match budget {
        Budget::MaxError(most) => format!("the quickest within {most:.2e} at every pixel"),
        Budget::MaxSeconds(most) => format!("the most exact within {:.3} ms a view", 1e3 * most),
    };
    let Quantiles { low, median, high } = row.times().times(1e3);
    let Verification { views, error, seconds } = choice.verification;
    let failed = match choice.failed {
        0 => String::new(),
        count => format!("; {count} that looked better did not keep it there"),
    };
    format!(
        "{what}: {asked}.\n{} on {}: {median:.3} ms ({low:.3} to {high:.3}), largest error {:.2e}, PSNR {:.1} dB.\nOn {views} other views: \
         {:.3} ms, largest error {:.2e}, PSNR {:.1} dB{failed}.",
        row.name(),
        row.machine,
        row.error.max,
        row.error.psnr(),
        1e3 * seconds,
        error.max,
        error.psnr()
    )
}
