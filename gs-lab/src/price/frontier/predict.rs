//! Predicts which combinations lie on the frontier, assuming that time ratios multiply and errors
//! add up.

use super::Setting;

/// A value of a setting, measured alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Alone {
    /// The value; `None` for the default's.
    pub(super) setting: Option<Setting>,
    /// The time divided by the default's.
    pub(super) ratio: f64,
    /// The largest error if the value is the only approximation.
    pub(super) error: f64,
}

/// A combination of values of several settings.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Combination {
    /// Differences from the default.
    pub(super) settings: Vec<Setting>,
    /// Predicted time divided by the default's.
    pub(super) ratio: f64,
    /// Predicted error: the sum of the single errors, an upper bound as long as settings do not
    /// influence each other.
    pub(super) error: f64,
}

/// The predicted frontier over all choices of one value per setting, quickest first, thinned out to
/// `most` combinations including both ends.
pub(super) fn combinations(settings: &[Vec<Alone>], most: usize) -> Vec<Combination> {
    let mut frontier = vec![Combination { settings: Vec::new(), ratio: 1.0, error: 0.0 }];
    for values in settings {
        // A combination that is excluded stays so: each further value multiplies and adds alike.
        let with = |combination: &Combination, value: &Alone| Combination {
            settings: combination.settings.iter().copied().chain(value.setting).collect(),
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
fn undominated(mut all: Vec<Combination>) -> Vec<Combination> {
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
    use super::*;

    #[test]
    fn the_frontier_of_two_settings_is_that_of_all_pairs() {
        let value = |setting, ratio, error| Alone { setting, ratio, error };
        let (coarse, fine) = (Setting::AlphaCut(0.1), Setting::AlphaCut(1e-4));
        let (early, late) = (Setting::TransmittanceMin(0.1), Setting::TransmittanceMin(0.0));
        let settings = [
            vec![value(None, 1.0, 4e-3), value(Some(coarse), 0.5, 0.1), value(Some(fine), 2.0, 1e-4)],
            vec![value(None, 1.0, 1e-4), value(Some(early), 0.9, 0.05), value(Some(late), 1.0, 0.0)],
        ];
        let found = combinations(&settings, 100);
        let names: Vec<_> = found.iter().map(|combination| combination.settings.clone()).collect();
        // "late" is as quick and more exact than the default of the second setting, so that one is
        // never chosen.
        assert_eq!(
            names,
            [vec![coarse, early], vec![coarse, late], vec![early], vec![late], vec![fine, early], vec![fine, late]]
                .into_iter()
                .filter(|n| *n != [fine, early])
                .collect::<Vec<_>>()
        );
        let ends = combinations(&settings, 2);
        assert_eq!((&ends[0], ends.last()), (&found[0], found.last()));
    }
}
