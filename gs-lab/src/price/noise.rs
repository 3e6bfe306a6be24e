//! The difference below which two times count as equal.

use std::cmp::Ordering;

use crate::result::median;
use gs_density::Rng;
use rand::{RngExt, SeedableRng};
use serde::Serialize;

/// Number of resampled pairs of medians.
const DRAWS: usize = 2000;

/// Share of the pairs that differ by less than the noise.
const CONFIDENCE: f64 = 0.95;

/// Seed of the resampling; fixed, so that equal times give equal verdicts.
const SEED: u64 = 0x006e_6f69_7365;

/// The noise of time measurements, as the difference between two measurements of the same setting.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct Noise {
    /// Noise factor, at least 1. Medians differ if their ratio is above this or below its inverse.
    pub(crate) factor: f64,
    /// The second median divided by the first.
    pub(crate) again: f64,
}

/// The verdict on two times.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum TimeComparison {
    /// Shorter by more than the noise.
    Faster,
    /// Within the noise.
    NoDifference,
    /// Longer by more than the noise.
    Slower,
}

impl TimeComparison {
    /// The verdict as reports print it.
    pub(crate) fn words(self) -> &'static str {
        match self {
            Self::Faster => "faster",
            Self::NoDifference => "no difference",
            Self::Slower => "slower",
        }
    }
}

impl Noise {
    /// Of times that do not vary.
    pub(super) const NONE: Self = Self { factor: 1.0, again: 1.0 };

    /// The noise of a setting that was measured twice, with at least one time each. Pairs of
    /// medians are resampled from all times together; the noise is what 95 % of the pairs stay
    /// within, or the observed difference of the two if that is larger.
    pub(crate) fn of(first: &[f64], again: &[f64]) -> Self {
        let all: Vec<f64> = first.iter().chain(again).copied().collect();
        let observed = median(again) / median(first);
        let mut rng = Rng::seed_from_u64(SEED);
        let mut draw = |n: usize| median((0..n).map(|_| all[rng.random_range(0..all.len())]));
        let mut ratios: Vec<f64> = (0..DRAWS).map(|_| (draw(again.len()) / draw(first.len())).ln().abs()).collect();
        ratios.sort_unstable_by(f64::total_cmp);
        let drawn = ratios[(CONFIDENCE * DRAWS as f64) as usize];
        Self { factor: drawn.max(observed.ln().abs()).exp(), again: observed }
    }

    /// Compares a time with another.
    pub(crate) fn compare(self, seconds: f64, with: f64) -> TimeComparison {
        let is_less = |a: f64, b: f64| (a * self.factor).total_cmp(&b) == Ordering::Less;
        if is_less(seconds, with) {
            TimeComparison::Faster
        } else if is_less(with, seconds) {
            TimeComparison::Slower
        } else {
            TimeComparison::NoDifference
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_settings_do_not_differ_and_others_do() {
        let times = |of: f64| (0..21).map(|i| of * (1.0 + 0.02 * f64::from(i % 7))).collect::<Vec<_>>();
        let noise = Noise::of(&times(1.0), &times(1.01));
        assert!((1.01..1.06).contains(&noise.factor), "{noise:?}");
        assert!((noise.again - 1.01).abs() < 1e-9);
        assert_eq!(noise.compare(1.0, 1.005), TimeComparison::NoDifference);
        assert_eq!(noise.compare(1.0, 1.1), TimeComparison::Faster);
        assert_eq!(noise.compare(1.1, 1.0), TimeComparison::Slower);
    }

    #[test]
    fn a_shift_between_the_two_is_noise_even_where_each_is_steady() {
        let noise = Noise::of(&[1.0; 9], &[1.2; 9]);
        assert!(noise.factor >= 1.2 - 1e-12, "{noise:?}");
    }
}
