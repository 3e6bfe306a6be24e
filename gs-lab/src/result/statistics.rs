//! Means, variances, and bootstrap intervals of means, for experiments and studies.

pub(crate) use gs_core::metrics::mean;
pub(crate) use gs_core::metrics::median;
use gs_density::Rng;
use probability::distribution::{Beta, Distribution, Gaussian, Inverse};
use rand::{RngExt, SeedableRng};

/// Number of bootstrap resamples.
const RESAMPLES: usize = 10_000;

/// Fewest pairs for a verdict. With five, the interval is at most as wide as the values' range, and
/// without a true difference all five have the same sign in one of sixteen studies: more often than
/// an interval of 95 % may be wrong.
pub(crate) const FEWEST: usize = 6;

/// Nominal coverage of the intervals.
const CONFIDENCE: f64 = 0.95;

/// Seed of the resampling; fixed, so that equal data give equal tables.
const SEED: u64 = 0x6773_2d73_7475_6479;

/// A confidence interval of a mean.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Interval {
    /// Lower end.
    pub(crate) low: f64,
    /// Upper end.
    pub(crate) high: f64,
}

/// The sample variance (with n − 1); `None` for fewer than two values.
pub(crate) fn variance(values: &[f64]) -> Option<f64> {
    let center = mean(values);
    let squares: f64 = values.iter().map(|value| (value - center).powi(2)).sum();
    (values.len() > 1).then(|| squares / (values.len() - 1) as f64)
}

/// Values in clusters in strata, for [`cluster_interval`].
///
/// A cluster holds values that are related, such as those of the views of one scene; a stratum holds
/// clusters that were drawn independently, such as the runs of one scene from several seeds.
pub(crate) type Strata = Vec<Vec<Vec<f64>>>;

/// The mean over strata of the mean over their clusters of the mean over the clusters' values; NaN
/// of nothing.
pub(crate) fn mean_of_strata(strata: &Strata) -> f64 {
    mean(strata.iter().map(|clusters| mean(clusters.iter().map(mean))))
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
    cluster_interval(&vec![values.iter().map(|&value| vec![value]).collect()])
}

/// The interval of [`mean_of_strata`] by a two-level bootstrap: each resample draws the clusters of
/// each stratum with replacement, and then the values of each drawn cluster with replacement.
/// Strata are not drawn: the interval is about these strata.
///
/// Values of one cluster need not be independent, because clusters are drawn as a whole; the
/// interval of many related values is therefore as wide as that of few clusters. Drawing values as
/// well makes it a little wider than necessary (Davison and Hinkley 1997, §3.8). The percentiles
/// are expanded as those of [`bootstrap_interval`], with the degrees of freedom of the clusters.
///
/// `None` where a stratum has fewer than two clusters, a cluster has no value, or a value is not
/// finite.
pub(crate) fn cluster_interval(strata: &Strata) -> Option<Interval> {
    interval_from(strata, RESAMPLES)
}

fn interval_from(strata: &Strata, resamples: usize) -> Option<Interval> {
    let values = strata.iter().flatten().flatten();
    let is_usable = values.clone().count() > 0 && values.clone().all(|value| value.is_finite());
    if !is_usable || strata.iter().flatten().any(Vec::is_empty) {
        return None;
    }
    let fewest = strata.iter().map(Vec::len).min()?;
    let tail = expanded_tail(fewest, freedom(strata))?;
    let mut rng = Rng::seed_from_u64(SEED);
    let mut means: Vec<f64> = (0..resamples).map(|_| resampled_mean(strata, &mut rng)).collect();
    means.sort_unstable_by(f64::total_cmp);
    Some(Interval { low: quantile(&means, tail), high: quantile(&means, 1.0 - tail) })
}

/// Degrees of freedom of the clusters' spread: their number less that of the strata.
pub(crate) fn freedom(strata: &Strata) -> usize {
    strata.iter().map(|clusters| clusters.len().saturating_sub(1)).sum()
}

/// [`mean_of_strata`] of one resample.
fn resampled_mean(strata: &Strata, rng: &mut Rng) -> f64 {
    let mut sum = 0.0;
    for clusters in strata {
        let n = clusters.len();
        let drawn = (0..n).map(|_| {
            let cluster = &clusters[rng.random_range(0..n)];
            match cluster.len() {
                1 => cluster[0],
                m => (0..m).map(|_| cluster[rng.random_range(0..m)]).sum::<f64>() / m as f64,
            }
        });
        sum += drawn.sum::<f64>() / n as f64;
    }
    sum / strata.len() as f64
}

/// The share of resampled means to cut off at either end: Φ(−√(n/(n−1)) t), with Student's quantile
/// t of this many degrees of freedom, for `n` clusters in each stratum. `None` for fewer than two.
fn expanded_tail(n: usize, freedom: usize) -> Option<f64> {
    if n < 2 {
        return None;
    }
    // ν / (ν + t²) has a beta distribution.
    let half = 0.5 * freedom as f64;
    let share = Beta::new(half, 0.5, 0.0, 1.0).inverse(1.0 - CONFIDENCE);
    let student = (freedom as f64 * (1.0 - share) / share).sqrt();
    Some(Gaussian::new(0.0, 1.0).distribution(-(n as f64 / (n - 1) as f64).sqrt() * student))
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
    use crate::result::verdict::Verdict;

    /// Resamples for each of hundreds of studies: the test is about the shares of these.
    const FEW_RESAMPLES: usize = 2_000;

    /// `n` normally distributed values.
    fn normal(rng: &mut Rng, n: usize, mean: f64, sd: f64) -> Vec<f64> {
        let law = Gaussian::new(mean, sd);
        (0..n).map(|_| law.inverse(rng.random_range(1e-12..1.0 - 1e-12))).collect()
    }

    #[test]
    fn tails_are_those_of_students_tables() {
        // Student's quantiles for 97.5 %, to three digits as in tables.
        for (freedom, student) in [(2, 4.303), (7, 2.365), (30, 2.042), (1000, 1.962)] {
            let n = freedom + 1;
            let expected = Gaussian::new(0.0, 1.0).distribution(-(n as f64 / freedom as f64).sqrt() * student);
            let tail = expanded_tail(n, freedom).unwrap();
            assert!((tail / expected - 1.0).abs() < 5e-3, "{freedom}: {tail}, not {expected}");
        }
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
    fn five_of_a_hundred_studies_differ_by_chance() {
        let mut rng = Rng::seed_from_u64(2);
        let studies = 400;
        let seen = (0..studies)
            .filter(|_| {
                let nothing = normal(&mut rng, 8, 0.0, 0.3).into_iter().map(|value| vec![value]).collect();
                let Interval { low, high } = interval_from(&vec![nothing], FEW_RESAMPLES).unwrap();
                low > 0.0 || high < 0.0
            })
            .count();
        // 20 are expected; 4 standard deviations are 17.
        assert!((4..=37).contains(&seen), "{seen} of {studies}");
    }

    #[test]
    fn without_expansion_the_intervals_of_few_values_are_too_narrow() {
        assert!((expanded_tail(8, 7).unwrap() - 0.0057).abs() < 1e-4);
        assert!(expanded_tail(10_000, 9_999).unwrap() > 0.024);
    }

    #[test]
    fn too_little_has_no_interval() {
        assert_eq!(bootstrap_interval(&[1.0]), None);
        assert_eq!(bootstrap_interval(&[1.0, 1.0, 1.0, 1.0, 1.0, f64::INFINITY]), None);
        assert_eq!(bootstrap_interval(&[0.0; 6]), Some(Interval { low: 0.0, high: 0.0 }));
        assert_eq!((mean([1.0, 3.0]), variance(&[1.0, 3.0]), variance(&[1.0])), (2.0, Some(2.0), None));
    }

    #[test]
    fn the_interval_of_clusters_is_that_worked_out_by_hand() {
        // Two clusters of equal values: the resampled means are 1, 2 and 3 with chances of 1/4, 1/2
        // and 1/4. Student's quantile of 12.7 cuts nothing off.
        let two = vec![vec![vec![1.0, 1.0, 1.0], vec![3.0]]];
        assert_eq!(mean_of_strata(&two), 2.0);
        assert_eq!(cluster_interval(&two), Some(Interval { low: 1.0, high: 3.0 }));
        // Two strata of three clusters, of which the second is 10 higher: drawn clusters stay in
        // their strata, so the mean is between 5 and 7. Tail: t of 4 degrees of freedom is 2.776,
        // times the root of 3/2 is 3.400, cut off 3.4e-4. All nine draws of ten thousand that are
        // lowest have the chance (1/27)², 13.7 of them; so the ends are the extremes.
        let strata = vec![vec![vec![0.0], vec![1.0], vec![2.0]], vec![vec![10.0], vec![11.0], vec![12.0]]];
        assert_eq!((mean_of_strata(&strata), freedom(&strata)), (6.0, 4));
        assert_eq!(cluster_interval(&strata), Some(Interval { low: 5.0, high: 7.0 }));
        // The mean of 0 and 2 is 1 in every cluster, and only drawing values varies it: with twelve
        // values, by 1/√12 = 0.289, and t of 5 degrees is 2.571, times the root of 6/5: 2.816.
        let within = vec![vec![vec![0.0, 2.0]; 6]];
        let Interval { low, high } = cluster_interval(&within).unwrap();
        assert!((high - low - 2.0 * 2.816 * 0.2887).abs() < 0.12, "{low} to {high}");
    }

    #[test]
    fn values_of_one_cluster_do_not_count_as_independent() {
        // A hundred times the same six values say no more than these six.
        let six = [0.3, -0.1, 0.2, 0.5, 0.1, 0.4];
        let many: Strata = vec![six.iter().map(|&value| vec![value; 100]).collect()];
        let (few, many) = (bootstrap_interval(&six).unwrap(), cluster_interval(&many).unwrap());
        assert!((few.low - many.low).abs() < 0.03 && (few.high - many.high).abs() < 0.03, "{few:?} {many:?}");
        let flat = bootstrap_interval(&six.map(|value| [value; 100]).concat()).unwrap();
        assert!(flat.high - flat.low < 0.2 * (few.high - few.low), "{flat:?}");
        assert_eq!(cluster_interval(&vec![vec![vec![1.0], vec![2.0]], vec![vec![1.0]]]), None, "a single cluster");
        assert_eq!(cluster_interval(&vec![vec![vec![1.0], vec![]]]), None);
        assert_eq!(cluster_interval(&Strata::new()), None);
    }

    #[test]
    fn related_views_seldom_show_a_false_difference() {
        let mut rng = Rng::seed_from_u64(3);
        let studies = 150;
        // Four scenes from three seeds, each run with an error of its own that all its views share.
        let nothing = |rng: &mut Rng| -> Strata {
            let run = |rng: &mut Rng| {
                let shared = normal(rng, 1, 0.0, 0.3)[0];
                normal(rng, 8, shared, 0.2)
            };
            (0..4).map(|_| (0..3).map(|_| run(rng)).collect()).collect()
        };
        let seen = (0..studies)
            .filter(|_| Verdict::of(interval_from(&nothing(&mut rng), FEW_RESAMPLES).unwrap()) != Verdict::CannotTell)
            .count();
        // 7.5 are expected; 4 standard deviations are 11. The interval is a little too wide.
        assert!((1..=18).contains(&seen), "{seen} of {studies}");
    }
}
