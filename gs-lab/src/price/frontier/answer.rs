//! The answer to a budget: the flags of settings, with their measurements on the views of the search
//! and on others.

use gs_core::{Accuracy, Cut, RenderSettings, counted, effects::Effect, profile::Quantiles};
use serde::Serialize;

use super::{
    super::reference::Verifiable,
    Frontier, Measured, Sweep,
    budget::{Budget, Choice, Missed, Verification},
};

/// Settings that keep a budget.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct Answer {
    budget: Budget,
    /// The differences from the default, in words.
    settings: String,
    machine: String,
    #[serde(flatten)]
    choice: Choice,
    /// The flags of `gs render` that choose them.
    flags: String,
    /// What was measured, as lines of comments, and the flags.
    #[serde(skip)]
    pub(super) text: String,
}

impl Answer {
    /// The answer for the scene `what`.
    pub(super) fn new<S: Verifiable>(
        budget: Budget,
        choice: Choice,
        sweep: &Sweep<'_, S>,
        frontier: &Frontier,
        what: &str,
    ) -> Self {
        let row = &frontier.rows[choice.row];
        let comment = comment(budget, &choice, row, frontier.noise_of(&row.backend).factor, what);
        let comment: String = comment.lines().map(|line| format!("# {line}\n")).collect();
        let flags = format!("{} {}", flags(&row.settings, &sweep.shown), row.flags.as_deref().unwrap_or_default());
        let text = format!("{comment}{flags}");
        Self { budget, settings: row.name(), machine: row.machine.clone(), choice, flags, text }
    }
}

/// The flags of `gs render` for settings that differ from the scene's `usual` ones. Effects are named even where
/// only the command asked for them.
fn flags(settings: &RenderSettings, usual: &RenderSettings) -> String {
    let cutoffs = |Accuracy { alpha_cut, alpha_max, transmittance_min, cut, .. }: Accuracy| {
        let cut = if cut == Cut::Hard { "hard" } else { "smooth" }.to_owned();
        let numbers = [("alpha-cut", alpha_cut), ("alpha-max", alpha_max), ("transmittance-min", transmittance_min)];
        numbers.map(|(name, value)| (name, value.to_string())).into_iter().chain([("cut", cut)])
    };
    let changed = cutoffs(settings.accuracy).zip(cutoffs(usual.accuracy)).filter(|(new, old)| new != old);
    let changed: Vec<String> = changed.map(|((name, value), _)| format!("{name}={value}")).collect();
    let mut flags = vec!["--effects all".to_owned()];
    if !changed.is_empty() {
        flags.push(format!("--accuracy {}", changed.join(",")));
    }
    // A background is a colour, which no settings change.
    let effects = Effect::OPTIONAL.into_iter().filter(|effect| *effect != Effect::Background);
    let plain = RenderSettings::default().effects;
    for (effect, value) in effects.map(|effect| (effect, effect.value(&settings.effects))) {
        if value != effect.value(&usual.effects) || value != effect.value(&plain) {
            flags.push(format!("--{effect} {value}"));
        }
    }
    flags.join(" ")
}

/// Why no settings keep the budget on the views of the search and on so many others, and what helps
/// besides a larger budget.
pub(super) fn missed(budget: Budget, why: Missed, others: usize) -> (String, &'static str) {
    match (why, budget) {
        (Missed::OutOfReach(best), Budget::MaxError(_)) => {
            (format!("the most exact settings are off by {best:.1e}"), "")
        }
        (Missed::OutOfReach(best), Budget::MaxSeconds(_)) => {
            (format!("the quickest settings take {:.3} ms", 1e3 * best), "")
        }
        (Missed::NotElsewhere(count), _) => {
            let (settings, views) = (counted(count, "setting"), counted(others, "other view"));
            let more = ", as a margin for other views, or let the search see more with --views";
            (format!("kept by {settings} on the views of the search, but by none on {views}"), more)
        }
    }
}

fn comment(budget: Budget, choice: &Choice, row: &Measured, noise: f64, what: &str) -> String {
    let asked = match budget {
        Budget::MaxError(most) => format!("the quickest within {most:.2e} at every pixel"),
        Budget::MaxSeconds(most) => format!("the most exact within {:.3} ms a view", 1e3 * most),
    };
    let Quantiles { low, median, high } = row.seconds.spread.times(1e3);
    let Verification { views, error, seconds } = choice.verification;
    let failed = match choice.failed {
        0 => String::new(),
        count => format!("; {count} that looked better did not keep it there"),
    };
    let noise = match choice.within_noise {
        0 => String::new(),
        count => format!(
            "\nThe noise is {:.0} %; within it, {} the budget as quickly, of which another run may choose one.",
            100.0 * (noise - 1.0),
            if count == 1 { "1 other setting keeps".to_owned() } else { format!("{count} other settings keep") }
        ),
    };
    format!(
        "{what}: {asked}.\n{} on {}: {median:.3} ms ({low:.3} to {high:.3}), largest error {:.2e}, PSNR {:.1} dB.\nOn {}: \
         {:.3} ms, largest error {:.2e}, PSNR {:.1} dB{failed}.{noise}",
        row.name(),
        row.machine,
        row.error.max,
        row.error.psnr,
        counted(views, "other view"),
        1e3 * seconds,
        error.max,
        error.psnr
    )
}
