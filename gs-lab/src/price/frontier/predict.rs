//! Predicts which combinations lie on the frontier, assuming that time ratios multiply and errors
//! add up.

use super::setting::Setting;

/// Values of settings: one, measured alone, or a combination.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Predicted {
    /// Differences from the default.
    pub(super) settings: Vec<Setting>,
    /// The time divided by the default's.
    pub(super) ratio: f64,
    /// The largest error if these are the only approximations. For a combination, the sum of the
    /// single errors: an upper bound as long as settings do not influence each other.
    pub(super) error: f64,
}

/// The predicted frontier over all choices of one value for each axis, quickest first, thinned out to
/// `most` combinations including both ends. The values of an axis include the default's.
pub(super) fn combinations(axes: &[Vec<Predicted>], most: usize) -> Vec<Predicted> {
    let mut frontier = vec![Predicted { settings: Vec::new(), ratio: 1.0, error: 0.0 }];
    for values in axes {
        // A combination that is excluded stays so: each further value multiplies and adds alike.
        let with = |combination: &Predicted, value: &Predicted| Predicted {
            settings: combination.settings.iter().chain(&value.settings).copied().collect(),
            ratio: combination.ratio * value.ratio,
            error: combination.error + value.error,
        };
        let all = frontier.iter().flat_map(|combination| values.iter().map(|value| with(combination, value)));
        frontier = undominated(all.collect());
    }
    let last = frontier.len().saturating_sub(1);
    let kept: Vec<usize> = (0..most.max(2)).map(|i| i * last / (most.max(2) - 1)).collect();
    frontier.into_iter().enumerate().filter(|(i, _)| kept.contains(i)).map(|(_, combination)| combination).collect()
}

/// Keeps the combinations that are more exact than all quicker ones, quickest first; of equal ones
/// the one with the fewest changes.
fn undominated(mut all: Vec<Predicted>) -> Vec<Predicted> {
    all.sort_by(|a, b| {
        let by_time = a.ratio.total_cmp(&b.ratio).then(a.error.total_cmp(&b.error));
        by_time.then(a.settings.len().cmp(&b.settings.len()))
    });
    let mut least = f64::INFINITY;
    all.retain(|combination| {
        let is_better = combination.error < least;
        least = least.min(combination.error);
        is_better
    });
    all
}

#[cfg(test)]
mod tests {
    use super::{
        super::setting::{Axis, tests::setting},
        *,
    };

    #[test]
    fn the_frontier_of_two_settings_is_that_of_all_pairs() {
        let value = |settings: &[Setting], ratio, error| Predicted { settings: settings.to_vec(), ratio, error };
        let [coarse, fine] = [0.1, 1e-4].map(|cut| setting(Axis::AlphaCut, |s| s.accuracy.alpha_cut = cut));
        let [early, late] =
            [0.1, 0.0].map(|least| setting(Axis::TransmittanceMin, |s| s.accuracy.transmittance_min = least));
        let axes = [
            vec![value(&[], 1.0, 4e-3), value(&[coarse], 0.5, 0.1), value(&[fine], 2.0, 1e-4)],
            vec![value(&[], 1.0, 1e-4), value(&[early], 0.9, 0.05), value(&[late], 1.0, 0.0)],
        ];
        let found = combinations(&axes, 100);
        let names: Vec<_> = found.iter().map(|combination| combination.settings.clone()).collect();
        // "late" is as quick and more exact than the default of the second setting, so that one is
        // never chosen.
        assert_eq!(names, [vec![coarse, early], vec![coarse, late], vec![early], vec![late], vec![fine, late]]);
        let ends = combinations(&axes, 2);
        assert_eq!((&ends[0], ends.last()), (&found[0], found.last()));
    }
}
