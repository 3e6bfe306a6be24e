//! [`Grow`] by name, in settings files, and in words.

use gs_core::Error;
use serde::{Deserialize, Serialize};

use super::{Combine, Grow};
use crate::{
    observation::Signal,
    policy::{
        Named, Policy,
        partial::{ActionsForm, Over as _},
        rule::{Rule, check_percent},
    },
    round::{Actions, Densify, SplitPlacement, WhenFlat},
};

/// Threshold of `long-axis` on the absolute gradient. *Source:* the code of Deng et al. 2024,
/// without its schedule of factors.
const LONG_AXIS_THRESHOLD: f32 = 3.5e-4;

/// The policies that are a [`Grow`].
pub(crate) const NAMED: [Named; 8] = [
    named("absolute", "Grow where the positional gradient exceeds a fixed threshold (3DGS)", || {
        grow(Grow::absolute(Signal::MeanGradient))
    }),
    named("abs-gs", "Grow where the absolute gradient, which does not cancel, exceeds a threshold (AbsGS)", || {
        grow(Grow::abs_gs())
    }),
    named(
        "pixel-gs",
        "Grow where the gradient, weighted by the pixels that a Gaussian covers in each view, exceeds a threshold \
         (Pixel-GS)",
        || grow(Grow::absolute(Signal::PixelGradient)),
    ),
    named(
        "absolute-error",
        "Grow where the error of the covered pixels exceeds a threshold (Revising Densification)",
        || grow(Grow::absolute(Signal::PixelError)),
    ),
    named("percentile", "Grow the top percents by positional gradient (the paper's forced growth)", || {
        grow(Grow::percentile(Signal::MeanGradient))
    }),
    named("percentile-abs-gs", "Grow the top percents by absolute gradient", || {
        grow(Grow::percentile(Signal::AbsoluteGradient))
    }),
    named("long-axis", "Grow as abs-gs does, but split side by side along the long axis", || {
        grow(Grow {
            threshold: LONG_AXIS_THRESHOLD,
            actions: Actions { densify: Densify::along_long_axes(), ..Actions::default() },
            ..Grow::absolute(Signal::AbsoluteGradient)
        })
    }),
    named("paper", "The paper's experiment: the top percents together with the fixed threshold", || {
        grow(Grow::paper(Signal::MeanGradient))
    }),
];

const fn named(name: &'static str, summary: &'static str, make: fn() -> Policy) -> Named {
    Named { name, summary, make }
}

fn grow(grow: Grow) -> Policy {
    Policy::Grow(grow)
}

/// The constructor of [`Grow`] that makes a rule like this one: `paper`, `absolute` or `percentile`.
pub(crate) fn kind(grow: &Grow) -> &'static str {
    match grow.combine {
        Combine::Either => "paper",
        Combine::Both if grow.percent >= 100.0 => "absolute",
        Combine::Both => "percentile",
    }
}

/// The nearest name of a rule, as in [`NAMED`], by its kind, signal and split.
pub(crate) fn name(grow: &Grow) -> &'static str {
    let splits_along = matches!(grow.actions.densify.split_placement, SplitPlacement::LongAxisSplit(_));
    match (kind(grow), grow.signal) {
        ("absolute", Signal::AbsoluteGradient) if splits_along => "long-axis",
        ("absolute", Signal::AbsoluteGradient) => "abs-gs",
        ("absolute", Signal::PixelGradient) => "pixel-gs",
        ("absolute", Signal::PixelError) => "absolute-error",
        ("percentile", Signal::AbsoluteGradient) => "percentile-abs-gs",
        (kind, _) => kind,
    }
}

impl Rule for Grow {
    fn validate(&self) -> Result<(), Error> {
        check_percent(self.percent)?;
        Error::within("threshold", self.threshold, 0.0.., "0 or more")?;
        Error::within("full-depth", self.full_depth, 0.0..=f32::MAX, "0 or more, and finite")?;
        self.actions.validate()
    }

    fn actions(&self) -> Option<&Actions> {
        Some(&self.actions)
    }

    fn actions_mut(&mut self) -> Option<&mut Actions> {
        Some(&mut self.actions)
    }

    fn aims_at_budget(&self) -> bool {
        kind(self) == "percentile" && self.threshold > 0.0
    }
}

/// [`Grow`] in a settings file, where `kind` gives the values of missing keys.
#[derive(Default, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct GrowForm {
    signal: Signal,
    percent: Option<f32>,
    threshold: Option<f32>,
    when_flat: WhenFlat,
    #[serde(skip_serializing_if = "Option::is_none")]
    full_depth: Option<f32>,
    actions: ActionsForm,
}

impl GrowForm {
    /// The settings of the file, completed from `usual`.
    pub(crate) fn or(self, usual: fn(Signal) -> Grow) -> Grow {
        let Self { signal, percent, threshold, when_flat, full_depth, actions } = self;
        let usual = usual(signal);
        Grow {
            percent: percent.unwrap_or(usual.percent),
            threshold: threshold.unwrap_or(usual.threshold),
            when_flat,
            full_depth: full_depth.unwrap_or(usual.full_depth),
            actions: actions.over(usual.actions),
            ..usual
        }
    }
}

impl From<Grow> for GrowForm {
    fn from(Grow { signal, percent, threshold, when_flat, full_depth, actions, .. }: Grow) -> Self {
        Self {
            signal,
            percent: Some(percent),
            threshold: Some(threshold),
            when_flat,
            full_depth: (full_depth != signal.full_depth()).then_some(full_depth),
            actions: ActionsForm::written(actions, &Actions::default()),
        }
    }
}
