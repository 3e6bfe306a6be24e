//! Means, variances, and bootstrap intervals of means, for experiments and studies.

use std::borrow::Borrow;

pub(crate) use gs_core::metrics::mean;
use gs_density::Rng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, Normal, StudentsT};

/// Number of bootstrap resamples.
pub(crate) const RESAMPLES: usize = 10_000;

/// Fewest pairs for a verdict. With five, the interval is at most as wide as the values' range, and
/// without a true difference all five have the same sign in one of sixteen studies: more often than
/// an interval of 95 % may be wrong.
pub(crate) const FEWEST: usize = 6;

/// Nominal coverage of the intervals.
pub(crate) const CONFIDENCE: f64 = 0.95;

/// Seed of the resampling; fixed, so that equal data give equal tables.
const SEED: u64 = 0x6773_2d73_7475_6479;

/// A confidence interval of a mean.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Interval {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// The median: the mean of the two middle values of an even number, NaN of none.
pub(crate) fn median(values: impl IntoIterator<Item: Borrow<f64>>) -> f64 {
    let mut values: Vec<f64> = values.into_iter().map(|value| *value.borrow()).collect();
    values.sort_unstable_by(f64::total_cmp);
    match values.len() {
        0 => f64::NAN,
        n if n % 2 == 1 => values[n / 2],
        n => (values[n / 2 - 1] + values[n / 2]) / 2.0,
    }
}

/// The sample variance (with n − 1); `None` for fewer than two values.
pub(crate) fn variance(values: &[f64]) -> Option<f64> {
    let center = mean(values);
    let squares: f64 = values.iter().map(|value| (value - center).powi(2)).sum();
    (values.len() > 1).then(|| squares / (values.len() - 1) as f64)
}

/// The bootstrap interval of the mean, from [`RESAMPLES`] resamples; equal values always give the
/// same interval. `None` for fewer than two values and where one is not finite; see also
/// [`FEWEST`].
///
/// For few values the plain percentile interval is too narrow: with eight normal values it covers
/// the mean 89 times out of a hundred instead of 95. The percentiles are therefore expanded so that
/// for normal data the interval is as wide as Student's. *Source:* Hesterberg 2015, "What teachers
/// should know about the bootstrap", §5.3 (expanded percentile interval).
pub(crate) fn bootstrap_interval(values: &[f64]) -> Option<Interval> {
    let n = values.len();
    if n < 2 || !values.iter().all(|value| value.is_finite()) {
        return None;
    }
    let tail = expanded_tail(n)?;
    let mut rng = Rng::seed_from_u64(SEED);
    let mut means: Vec<f64> =
        (0..RESAMPLES).map(|_| (0..n).map(|_| values[rng.random_range(0..n)]).sum::<f64>() / n as f64).collect();
    means.sort_unstable_by(f64::total_cmp);
    Some(Interval { low: quantile(&means, tail), high: quantile(&means, 1.0 - tail) })
}

/// The share of resampled means to cut off at either end: Φ(−√(n/(n−1)) t), with Student's quantile
/// t.
fn expanded_tail(n: usize) -> Option<f64> {
    let freedom = (n - 1) as f64;
    let student = StudentsT::new(0.0, 1.0, freedom).ok()?.inverse_cdf(0.5 + 0.5 * CONFIDENCE);
    let normal = Normal::new(0.0, 1.0).ok()?;
    Some(normal.cdf(-(n as f64 / freedom).sqrt() * student))
}

/// The quantile of sorted values, linearly interpolated.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let place = share * (sorted.len() - 1) as f64;
    let (below, part) = (place.floor() as usize, place.fract());
    let above = (below + 1).min(sorted.len() - 1);
    sorted[below] + part * (sorted[above] - sorted[below])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `n` normally distributed values.
    fn normal(rng: &mut Rng, n: usize, mean: f64, sd: f64) -> Vec<f64> {
        let law = Normal::new(mean, sd).unwrap();
        (0..n).map(|_| law.inverse_cdf(rng.random_range(1e-12..1.0 - 1e-12))).collect()
    }

    #[test]
    fn clear_differences_are_seen_and_their_sign_too() {
        let mut rng = Rng::seed_from_u64(1);
        let gains = normal(&mut rng, 8, 0.5, 0.2);
        let losses: Vec<f64> = gains.iter().map(|gain| -gain).collect();
        assert!(bootstrap_interval(&gains).unwrap().low > 0.0);
        assert!(bootstrap_interval(&losses).unwrap().high < 0.0);
        assert_eq!(bootstrap_interval(&gains), bootstrap_interval(&gains), "equal data, equal intervals");
    }

    #[test]
    fn where_there_is_no_difference_one_is_seen_in_five_of_a_hundred_studies() {
        let mut rng = Rng::seed_from_u64(2);
        let studies = 400;
        let seen = (0..studies)
            .filter(|_| {
                let nothing = normal(&mut rng, 8, 0.0, 0.3);
                let Interval { low, high } = bootstrap_interval(&nothing).unwrap();
                low > 0.0 || high < 0.0
            })
            .count();
        // 20 are expected; 4 standard deviations are 17.
        assert!((4..=37).contains(&seen), "{seen} of {studies}");
    }

    #[test]
    fn without_expansion_the_intervals_of_few_values_are_too_narrow() {
        assert!((expanded_tail(8).unwrap() - 0.0057).abs() < 1e-4);
        assert!(expanded_tail(10_000).unwrap() > 0.024);
    }

    #[test]
    fn too_little_has_no_interval() {
        assert_eq!(bootstrap_interval(&[1.0]), None);
        assert_eq!(bootstrap_interval(&[1.0, 1.0, 1.0, 1.0, 1.0, f64::INFINITY]), None);
        assert_eq!(bootstrap_interval(&[0.0; 6]), Some(Interval { low: 0.0, high: 0.0 }));
        assert_eq!((mean([1.0, 3.0]), variance(&[1.0, 3.0]), variance(&[1.0])), (2.0, Some(2.0), None));
    }

    #[test]
    fn the_median_is_in_the_middle() {
        assert_eq!(median([3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median([4.0, 1.0, 2.0, 3.0]), 2.5);
        assert!(median([0.0; 0]).is_nan());
    }
}
