//! Below what a difference of two times is none.

use std::cmp::Ordering;

use crate::statistics::median;
use gs_density::Rng;
use rand::{RngExt, SeedableRng};
use serde::Serialize;

/// Pairs of medians that are drawn.
const DRAWS: usize = 2000;

/// The share of them that differ by less than the noise.
const CONFIDENCE: f64 = 0.95;

/// Where the draws come from; fixed, so that equal times give equal verdicts.
const SEED: u64 = 0x006e_6f69_7365;

/// What two medians of one and the same setting differ by.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Noise {
    /// At least 1: medians whose ratio is nearer to 1 than this, in either direction, are not different.
    pub factor: f64,
    /// The ratio of the two that were measured, the second's median by the first's.
    pub again: f64,
}

/// What may be said of two times.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Comparison {
    /// Less than the noise allows for equal ones.
    Faster,
    /// Within the noise.
    NoDifference,
    /// More than the noise allows for equal ones.
    Slower,
}

impl Comparison {
    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Faster => "faster",
            Self::NoDifference => "no difference",
            Self::Slower => "slower",
        }
    }
}

impl Noise {
    /// Of a setting that was measured twice, as if it were two, with at least one time each. All times are put together and as many as each had are drawn from
    /// them, twice and again: the noise is what 95 % of such pairs of medians stay within, or what the two really differ by, if that is more.
    pub fn of(first: &[f64], again: &[f64]) -> Self {
        let all: Vec<f64> = first.iter().chain(again).copied().collect();
        let observed = median(again) / median(first);
        let mut rng = Rng::seed_from_u64(SEED);
        let mut draw = |n: usize| median((0..n).map(|_| all[rng.random_range(0..all.len())]));
        let mut ratios: Vec<f64> = (0..DRAWS).map(|_| (draw(again.len()) / draw(first.len())).ln().abs()).collect();
        ratios.sort_unstable_by(f64::total_cmp);
        let drawn = ratios[(CONFIDENCE * DRAWS as f64) as usize];
        Self { factor: drawn.max(observed.ln().abs()).exp(), again: observed }
    }

    /// How a time compares with another.
    pub fn compare(self, seconds: f64, with: f64) -> Comparison {
        let is_less = |a: f64, b: f64| (a * self.factor).total_cmp(&b) == Ordering::Less;
        if is_less(seconds, with) {
            Comparison::Faster
        } else if is_less(with, seconds) {
            Comparison::Slower
        } else {
            Comparison::NoDifference
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
        assert_eq!(noise.compare(1.0, 1.005), Comparison::NoDifference);
        assert_eq!(noise.compare(1.0, 1.1), Comparison::Faster);
        assert_eq!(noise.compare(1.1, 1.0), Comparison::Slower);
    }

    #[test]
    fn a_shift_between_the_two_is_noise_even_where_each_is_steady() {
        let noise = Noise::of(&[1.0; 9], &[1.2; 9]);
        assert!(noise.factor >= 1.2 - 1e-12, "{noise:?}");
    }
}
