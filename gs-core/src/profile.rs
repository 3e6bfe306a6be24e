//! Where the time of a training step goes, stage by stage, as backends report it.

use std::{fmt, future::Future};

use crate::{
    adam::{Adam, AdamRates},
    error::Error,
    loss::Loss,
    rasterizer::Optimizer,
    scene::Scene,
    settings::RenderSettings,
};

/// A backend that can say where the time of a training step goes.
pub trait Profiler<S: Scene>: Optimizer<S> {
    /// Runs every stage `repetitions` times, interleaved, after once without looking at the clock. The splats stays as it is but for
    /// its Adam moments, step counts and statistics: the rates are [`still`].
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

/// Adam's numbers for steps that move nothing: all learning rates are 0.
pub fn still() -> AdamRates {
    let mut adam = Adam::default();
    let Adam { mean, scale, rotation, opacity, color, color_rest, .. } = &mut adam;
    for group in [mean, scale, rotation, opacity, color, color_rest] {
        group.learning_rate = 0.0;
    }
    // Nor do scales where they are beyond a bound.
    (adam.min_scale, adam.max_scale) = (0.0, f32::INFINITY);
    adam.at(0.0)
}

/// One stage: its time, and what it did in that time.
#[derive(Debug, Clone, PartialEq)]
pub struct StageTime {
    /// The stage's word: `project`, `bin`, `sort`, `blend`, `loss`, `blend_bwd`, `project_bwd`, `adam`; on a GPU also `scan` and
    /// `ranges`, which stand before and after sorting; `fused` where a backend does several of them in one pass over the tiles.
    pub stage: &'static str,
    /// Seconds, one per repetition, in order.
    pub seconds: Vec<f64>,
    /// Pixel–Gaussian pairs that it visits; 0 where it visits none.
    pub pairs: u64,
    /// The stages that a training step with these settings does not run, because it runs this one instead; they are measured for
    /// comparison.
    pub replaces: &'static [&'static str],
}

/// What the seconds were measured by.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Clock {
    /// The host's, around each stage, which the host computes itself.
    Host,
    /// The host's; each stage was sent to the device alone and waited for, so that its time is that of its dispatches and of one
    /// round trip.
    RoundTrip {
        /// Why not the device's own clock.
        why: String,
    },
    /// Timestamps that the device writes between the stages of one submission, without a round trip.
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

/// What a profile measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    /// The stages in their order.
    pub stages: Vec<StageTime>,
    /// What measured their times.
    pub clock: Clock,
    /// Pixel–Gaussian pairs that a blend kernel visits, those that a vector covers beyond an ellipse included.
    pub pairs: u64,
    /// Entries of all tiles' lists.
    pub entries: usize,
}

impl Profile {
    /// The stages that a training step with fresh lists runs, in their order: all that no other one replaces.
    pub fn of_a_step(&self) -> impl Iterator<Item = &StageTime> {
        self.stages.iter().filter(|stage| self.replaced_by(stage).is_none())
    }

    /// The stage that a training step runs in place of this one.
    pub fn replaced_by(&self, stage: &StageTime) -> Option<&'static str> {
        self.stages.iter().find(|other| other.replaces.contains(&stage.stage)).map(|other| other.stage)
    }
}

/// The median of some numbers, and how they scatter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quantiles {
    /// The 10 % quantile.
    pub low: f64,
    /// The 50 % quantile.
    pub median: f64,
    /// The 90 % quantile.
    pub high: f64,
}

impl Quantiles {
    /// Of these numbers; between two of them, interpolated. NaN of none.
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

    /// All three times a factor.
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
