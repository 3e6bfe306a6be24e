//! Paired differences with their significance.

use crate::result::{Interval, bootstrap_interval};

pub(crate) use crate::result::{mean, median};

/// Difference of two PSNRs, dB; 0 for equal ones, even if both are infinite.
pub(crate) fn gain(of: f64, over: f64) -> f64 {
    if of == over { 0.0 } else { of - over }
}

/// The sign with which differences are shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Sense {
    /// The sign of the difference itself.
    Forward,
    /// The negated sign.
    Reversed,
}

/// A statistic of paired differences.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Paired {
    /// Number of pairs.
    pub(crate) pairs: usize,
    /// Number of negative differences.
    pub(crate) negative: usize,
    /// Mean of the differences.
    pub(crate) mean: f64,
    /// 95 % interval of the mean by [`bootstrap_interval`]; `None` with too few pairs.
    pub(crate) interval: Option<Interval>,
}

impl Paired {
    /// The statistic of independent differences. Without differences the mean is NaN.
    pub(crate) fn of(differences: &[f64]) -> Self {
        let negative = differences.iter().filter(|&&d| d < 0.0).count();
        Self { pairs: differences.len(), negative, mean: mean(differences), interval: bootstrap_interval(differences) }
    }

    /// Whether the whole interval is below 0.
    pub(crate) fn is_negative(&self) -> bool {
        self.interval.is_some_and(|interval| interval.high < 0.0)
    }

    /// The interval as text, with this many decimals.
    pub(crate) fn interval_in_words(&self, sense: Sense, decimals: usize) -> String {
        match (self.interval, sense) {
            (Some(Interval { low, high }), Sense::Forward) => {
                format!("95 % interval {low:+.decimals$} to {high:+.decimals$}")
            }
            (Some(Interval { low, high }), Sense::Reversed) => {
                format!("95 % interval {:+.decimals$} to {:+.decimals$}", -high, -low)
            }
            (None, _) if self.mean.is_infinite() => format!("{} in all, of which some are infinite", self.pairs),
            (None, _) => format!("{} in all, too few for an interval", self.pairs),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_pictures_are_equal_to_each_other_and_better_than_all_others() {
        let exact = f64::INFINITY;
        assert_eq!([gain(exact, exact), gain(exact, 60.0), gain(60.0, exact)], [0.0, exact, -exact]);
        let found = Paired::of(&[gain(exact, 60.0), gain(exact, exact), gain(61.0, 60.0)]);
        assert_eq!((found.mean, found.negative, found.interval), (exact, 0, None));
        assert_eq!(found.interval_in_words(Sense::Forward, 1), "3 in all, of which some are infinite");
    }

    #[test]
    fn a_clear_difference_is_one_and_noise_is_none() {
        let clear: Vec<f64> = (0..20).map(|i| -1.0 + 0.5 * f64::from(i).sin()).collect();
        let found = Paired::of(&clear);
        assert!(found.is_negative(), "{found:?}");
        let Interval { low, high } = found.interval.unwrap();
        assert!(low < found.mean && found.mean < high);
        assert!(found.interval_in_words(Sense::Reversed, 1).starts_with("95 % interval +"));
        assert_eq!(Paired::of(&[1.0]).interval_in_words(Sense::Forward, 1), "1 in all, too few for an interval");
        let noise: Vec<f64> = (0..20).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
        let found = Paired::of(&noise);
        assert!(!found.is_negative(), "{found:?}");
        assert_eq!(Paired::of(&clear), Paired::of(&clear));
        assert!(Paired::of(&[]).mean.is_nan() && !Paired::of(&[]).is_negative());
    }
}
