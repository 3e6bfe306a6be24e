//! Time of a training step, stage by stage, as backends report it.

use std::{fmt, future::Future};

use serde::Serialize;

use crate::{
    adam::{Adam, AdamRates},
    error::Error,
    rasterizer::Optimizer,
    scene::Scene,
    settings::RenderSettings,
    training::Loss,
};

/// A backend that measures the stages of a training step.
pub trait Profiler<S: Scene>: Optimizer<S> {
    /// Runs every stage `repetitions` times, interleaved, after one run that is not measured.
    ///
    /// Parameters do not change, as the rates are [`still`]; Adam moments, step counts and
    /// statistics do.
    ///
    /// # Errors
    /// Those of [`Optimizer::train_step`].
    fn profile(
        &self,
        splats: &mut Self::Splats,
        view: &S::View,
        target: &Self::Target,
        settings: &RenderSettings,
        loss: Loss,
        repetitions: usize,
    ) -> impl Future<Output = Result<Profile, Error>>;
}

/// Settings of Adam for steps that move nothing: all learning rates are 0.
pub fn still() -> AdamRates {
    let mut adam = Adam::default();
    let Adam { mean, scale, rotation, opacity, color, color_rest, .. } = &mut adam;
    for group in [mean, scale, rotation, opacity, color, color_rest] {
        group.learning_rate = 0.0;
    }
    // Scales beyond a bound do not move either.
    (adam.min_scale, adam.max_scale) = (0.0, f32::INFINITY);
    adam.at(0.0)
}

/// Time and work of one stage.
#[derive(Debug, Clone, PartialEq)]
pub struct StageTime {
    /// Name of the stage: `project`, `bin`, `sort`, `blend`, `loss`, `blend_bwd`, `project_bwd`,
    /// `adam`; on a GPU also `scan` and `ranges`, before and after sorting; `fused` or `update` where
    /// a backend does several of them in one pass over the tiles or the Gaussians.
    pub stage: &'static str,
    /// Seconds of each repetition, in order.
    pub seconds: Vec<f64>,
    /// Number of pixel–Gaussian pairs that the stage visits.
    pub pairs: u64,
    /// The stages that this one replaces in a training step with these settings; they are measured
    /// for comparison.
    pub replaces: &'static [&'static str],
}

/// Clock by which a profile was measured.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(tag = "clock", rename_all = "kebab-case")]
pub enum Clock {
    /// The host's clock, around stages that the host computes.
    Host,
    /// The host's clock, around stages that were sent to the device one by one, so that each
    /// includes a round trip.
    RoundTrip {
        /// Why the device's clock was not used.
        #[serde(rename = "clock_reason")]
        why: String,
    },
    /// Timestamps that the device writes between the stages of one submission, without a round
    /// trip.
    Device,
}

impl fmt::Display for Clock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Host => f.write_str("host"),
            Self::RoundTrip { why } => write!(f, "host, waiting after each stage ({why})"),
            Self::Device => f.write_str("device timestamps"),
        }
    }
}

/// Times of all stages of a training step.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    /// The stages in their order.
    pub stages: Vec<StageTime>,
    /// Clock by which the times were measured.
    pub clock: Clock,
    /// Number of pixel–Gaussian pairs that a blend kernel visits, including those that a vector
    /// covers beyond an ellipse.
    pub pairs: u64,
    /// Number of entries in all tiles' lists.
    pub entries: usize,
}

impl Profile {
    /// The stages that a training step with fresh lists runs, in their order.
    pub fn of_a_step(&self) -> impl Iterator<Item = &StageTime> {
        self.stages.iter().filter(|stage| self.replaced_by(stage).is_none())
    }

    /// The stage that a training step runs in place of this one.
    pub fn replaced_by(&self, stage: &StageTime) -> Option<&'static str> {
        self.stages.iter().find(|other| other.replaces.contains(&stage.stage)).map(|other| other.stage)
    }
}

/// Median and spread of some numbers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Quantiles {
    /// The 10 % quantile.
    pub low: f64,
    /// The 50 % quantile.
    pub median: f64,
    /// The 90 % quantile.
    pub high: f64,
}

impl Quantiles {
    /// The quantiles of these numbers, interpolated; NaN without any.
    pub fn of(numbers: &[f64]) -> Self {
        let mut sorted = numbers.to_vec();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| {
            let place = share * sorted.len().saturating_sub(1) as f64;
            let (low, high) = (sorted.get(place.floor() as usize), sorted.get(place.ceil() as usize));
            low.zip(high).map_or(f64::NAN, |(low, high)| low + (high - low) * place.fract())
        };
        Self { low: at(0.1), median: at(0.5), high: at(0.9) }
    }

    /// All three multiplied by a factor.
    pub fn times(self, factor: f64) -> Self {
        Self { low: self.low * factor, median: self.median * factor, high: self.high * factor }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_lie_between_the_numbers() {
        let tens: Vec<f64> = (0..=10).rev().map(|i| f64::from(i) * 10.0).collect();
        assert_eq!(Quantiles::of(&tens), Quantiles { low: 10.0, median: 50.0, high: 90.0 });
        assert_eq!(Quantiles::of(&[1.0, 2.0]).median, 1.5);
        assert_eq!(Quantiles::of(&[3.0]).times(2.0), Quantiles { low: 6.0, median: 6.0, high: 6.0 });
        assert!(Quantiles::of(&[]).median.is_nan());
    }

    #[test]
    fn a_step_runs_what_no_other_stage_replaces() {
        let stage = |stage, replaces| StageTime { stage, seconds: vec![1.0], pairs: 0, replaces };
        let stages = vec![stage("project", &[]), stage("blend", &[]), stage("fused", &["blend", "loss"])];
        let profile = Profile { stages, clock: Clock::Host, pairs: 0, entries: 0 };
        let names: Vec<&str> = profile.of_a_step().map(|stage| stage.stage).collect();
        assert_eq!(names, ["project", "fused"]);
        assert_eq!(profile.replaced_by(&profile.stages[1]), Some("fused"));
        assert_eq!(profile.replaced_by(&profile.stages[2]), None);
    }

    #[test]
    fn nothing_moves_at_still_rates() {
        let rates = still();
        for group in [rates.mean, rates.scale, rates.rotation, rates.opacity, rates.color, rates.color_rest] {
            assert_eq!(group.learning_rate, 0.0);
        }
    }
}
