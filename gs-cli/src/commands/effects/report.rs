//! The report of `gs effects`, as a table and as JSON.

use std::fmt::Write;

use gs_core::{counted, effects::EffectDecision};
use gs_lab::price::effects::{Difference, Price, Prices, Proof, TrainingOutcome, TrainingPrice};
use serde::Serialize;

/// What was examined.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct Facts {
    pub(crate) input: String,
    pub(crate) gaussians: usize,
    /// The views.
    pub(crate) seen: String,
    pub(crate) width: u32,
    pub(crate) height: u32,
    /// The backend, and why.
    pub(crate) machine: String,
}

/// What `gs effects --json` prints.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct Report {
    #[serde(flatten)]
    pub(crate) facts: Facts,
    pub(crate) proof: Proof,
    pub(crate) prices: Prices,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) training: Option<Training>,
}

/// What short trainings with and without corrections cost and gain.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct Training {
    pub(crate) steps: u32,
    pub(crate) prices: Vec<TrainingPrice>,
}

impl Training {
    fn text(&self) -> String {
        let steps = counted(self.steps, "step");
        if self.prices.is_empty() {
            return format!("\n\ntraining of {steps}: the views allow no correction to compare");
        }
        let mut text = format!(
            "\n\ntraining of {steps}, with and without each correction\n{:<12}{:>20}{:>20}{:>24}",
            "correction", "a step, ms", "PSNR, dB", "colours matched, dB"
        );
        for TrainingPrice { effect, with, without } in &self.prices {
            let pair = |of: fn(&TrainingOutcome) -> Option<f64>| {
                let cell = |outcome| of(outcome).map_or_else(|| "-".to_owned(), |value| format!("{value:.2}"));
                format!("{} / {}", cell(with), cell(without))
            };
            let (time, psnr) = (pair(|o| Some(o.milliseconds)), pair(|o| Some(o.psnr)));
            let _ = write!(text, "\n{:<12}{time:>20}{psnr:>20}{:>24}", effect.name(), pair(|o| o.color_matched));
        }
        text
    }
}

impl Report {
    /// The report as text.
    pub(crate) fn text(&self) -> String {
        let Self { facts: Facts { input, gaussians, seen, width, height, machine }, proof, prices, training } = self;
        let gaussians = counted(*gaussians, "Gaussian");
        let Prices { milliseconds, required_milliseconds, noise, .. } = prices;
        let mut text = format!("{input}: {gaussians}, seen from {seen}, {width}x{height} px\n{machine}\n\n");
        let titles = ["effect", "wanted", "required", "cost, ms", "%", "instead", "max error", "PSNR, dB", "why"];
        let rows: Vec<[String; 9]> = proof.required.decisions.iter().map(|decision| self.row(decision)).collect();
        let width = |column: usize| {
            let cells = rows.iter().map(|row| row[column].chars().count());
            cells.chain([titles[column].len()]).max().unwrap_or(0)
        };
        let widths: Vec<usize> = (0..titles.len() - 1).map(width).collect();
        for row in std::iter::once(titles.map(str::to_owned)).chain(rows) {
            let cells = row.iter().zip(&widths).enumerate();
            let line: String = cells
                .map(|(column, (cell, &width))| match column {
                    0..=2 | 5 => format!("{cell:<width$}  "),
                    _ => format!("{cell:>width$}  "),
                })
                .collect();
            let _ = writeln!(text, "{line}{}", row[8]);
        }
        let _ = write!(
            text,
            "\na picture takes {milliseconds:.2} ms with the wanted effects, {required_milliseconds:.2} ms with the required ones ({:.2} \
             times as fast); {noise:.2} ms are noise\nverified in {}: {}",
            milliseconds / required_milliseconds,
            counted(proof.views, "view"),
            match proof.difference {
                Difference { most: 0.0, .. } => "every pixel is the same".to_owned(),
                Difference { most, psnr } => format!("no pixel differs by more than {most:.6} (PSNR {psnr:.1} dB)"),
            }
        );
        text += &training.as_ref().map_or_else(String::new, Training::text);
        text
    }

    fn row(&self, verdict: &EffectDecision) -> [String; 9] {
        let EffectDecision { effect, wanted, value, reason, .. } = verdict;
        let price = self.prices.each.iter().find(|price| price.effect == *effect);
        let of = |cell: fn(&Price) -> String| price.map_or_else(String::new, cell);
        [
            effect.to_string(),
            (*wanted).to_owned(),
            (*value).to_owned(),
            of(|price| format!("{:.2}", price.milliseconds)),
            of(|price| format!("{:.0}", 100.0 * price.share)),
            of(|price| price.cheaper.to_owned()),
            of(|price| format!("{:.4}", price.change.most)),
            of(|price| format!("{:.1}", price.change.psnr)),
            reason.clone(),
        ]
    }
}

#[cfg(test)]
mod tests {
    use gs_core::{
        Effects, RenderSettings,
        effects::{Background, Effect, RequiredEffects},
    };

    use super::*;

    #[test]
    fn a_row_shows_the_cost_of_an_effect_and_what_it_changes() {
        let wanted = Effects { background: Background::Solid, ..Effects::default() };
        let verdicts = [Effect::Order, Effect::Background]
            .map(|effect| EffectDecision::new(effect, &wanted, &effect.off(&wanted), "because".to_owned()));
        let settings = RenderSettings::default().with(|s| s.effects = effect_free(&wanted));
        let difference = Difference { most: 0.0, psnr: f64::INFINITY };
        let price = Price {
            effect: Effect::Background,
            value: "solid",
            cheaper: "none",
            milliseconds: 0.5,
            share: 0.25,
            change: Difference { most: 0.125, psnr: 20.0 },
        };
        let report = Report {
            facts: Facts {
                input: "a.ply".to_owned(),
                gaussians: 3,
                seen: "its canvas".to_owned(),
                width: 8,
                height: 6,
                machine: "cpu".to_owned(),
            },
            proof: Proof { required: RequiredEffects { settings, decisions: verdicts.to_vec() }, difference, views: 1 },
            prices: Prices { milliseconds: 2.0, required_milliseconds: 1.5, noise: 0.1, each: vec![price] },
            training: None,
        };
        let text = report.text();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], "a.ply: 3 Gaussians, seen from its canvas, 8x6 px");
        let words = |line: &str| line.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
        assert_eq!(words(lines[4]), ["order", "index", "index", "because"]);
        assert_eq!(words(lines[5]), ["background", "solid", "none", "0.50", "25", "none", "0.1250", "20.0", "because"]);
        assert!(text.contains("(1.33 times as fast)") && text.ends_with("verified in 1 view: every pixel is the same"));
    }

    fn effect_free(wanted: &Effects) -> Effects {
        Effect::ALL.into_iter().fold(*wanted, |effects, effect| effect.off(&effects))
    }
}
