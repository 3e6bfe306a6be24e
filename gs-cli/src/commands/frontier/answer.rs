//! The answer to a budget: a settings file, with its measurements on the views of the search and on
//! others.

use gs_core::{Effects, RenderSettings, counted, profile::Quantiles};
use gs_lab::price::frontier::{
    Budget, Choice, Frontier, FrontierEffects, FrontierMachine, FrontierSettings, Measured, Noise, Verification,
};
use serde::Serialize;

use crate::failure::Failure;

/// Settings that keep a budget.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct Answer {
    budget: Budget,
    /// The differences from the default, in words.
    settings: String,
    machine: String,
    #[serde(flatten)]
    choice: Choice,
    /// The settings file.
    #[serde(skip)]
    pub(crate) file: String,
}

impl Answer {
    /// The answer for the scene `what`, with the effects that can be chosen for its kind.
    pub(crate) fn new(
        budget: Budget,
        choice: &Choice,
        frontier: &Frontier,
        machines: &[FrontierMachine],
        effects: fn(&Effects) -> Option<FrontierEffects>,
        what: &str,
    ) -> Result<Self, Failure> {
        let row = &frontier.rows[choice.row];
        let RenderSettings { accuracy, effects: row_effects, .. } = row.settings;
        let settings = FrontierSettings::default().with(|s| {
            (s.accuracy, s.effects, s.machine) = (accuracy, effects(&row_effects), machines[row.contender].clone());
        });
        let noise = frontier.noise_of(&row.backend);
        let comment: String =
            comment(budget, choice, row, noise, what).lines().map(|line| format!("# {line}\n")).collect();
        let file = comment + "\n" + &settings.to_toml().map_err(Failure::failed)?;
        Ok(Self { budget, settings: row.name(), machine: row.machine.clone(), choice: choice.clone(), file })
    }
}

/// The failure where no settings keep the budget; the best reach `best`.
pub(crate) fn out_of_reach(budget: Budget, best: f64) -> Failure {
    let (flag, most) = asked(budget);
    let best = match budget {
        Budget::MaxError(_) => format!("the most exact settings are off by {best:.1e}"),
        Budget::MaxSeconds(_) => format!("the quickest settings take {:.3} ms", 1e3 * best),
    };
    Failure::failed(format_args!("{flag} {most}: {best}")).hint(format_args!("give a larger {flag}"))
}

/// The failure where `count` settings keep the budget on the views of the search, but not on
/// others.
pub(crate) fn not_elsewhere(budget: Budget, count: usize, views: usize) -> Failure {
    let (flag, most) = asked(budget);
    let settings = if count == 1 {
        "the one setting that keeps it".to_owned()
    } else {
        format!("none of {count} settings that keep it")
    };
    let verb = if count == 1 { "does not keep" } else { "keeps" };
    Failure::failed(format_args!(
        "{flag} {most}: {settings} on the views of the search {verb} it on {}",
        counted(views, "other view")
    ))
    .hint(format_args!("give a larger {flag}, as a margin for other views, or let the search see more with --views"))
}

/// The flag of a budget, and its value.
fn asked(budget: Budget) -> (&'static str, f64) {
    match budget {
        Budget::MaxError(most) => ("--max-error", most),
        Budget::MaxSeconds(most) => ("--max-ms", 1e3 * most),
    }
}

fn comment(budget: Budget, choice: &Choice, row: &Measured, noise: Noise, what: &str) -> String {
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
    let noise = match choice.within_noise {
        0 => String::new(),
        count => format!(
            "\nThe noise is {:.0} %. {} the budget in times that differ by less, so another run may choose one of them. The setting chosen here \
             had the lowest median.",
            100.0 * (noise.factor - 1.0),
            if count == 1 { "1 other setting keeps".to_owned() } else { format!("{count} other settings keep") }
        ),
    };
    format!(
        "{what}: {asked}.\n{} on {}: {median:.3} ms ({low:.3} to {high:.3}), largest error {:.2e}, PSNR {:.1} dB.\nOn {}: \
         {:.3} ms, largest error {:.2e}, PSNR {:.1} dB{failed}.{noise}",
        row.name(),
        row.machine,
        row.error.max,
        row.error.psnr(),
        counted(views, "other view"),
        1e3 * seconds,
        error.max,
        error.psnr()
    )
}
