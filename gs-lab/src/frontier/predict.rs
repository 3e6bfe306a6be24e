//! Which combinations are worth measuring: those that lie on the frontier if times multiply and errors add up.

use super::Setting;

/// A value of one setting, as it was measured alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Alone {
    /// The value; nothing is that of the default.
    pub(super) setting: Option<Setting>,
    /// Its time by that of the default.
    pub(super) ratio: f64,
    /// The largest error where it is the only approximation.
    pub(super) error: f64,
}

/// A value for some of the settings.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Combination {
    /// What differs from the default.
    pub(super) settings: Vec<Setting>,
    /// Predicted, by the time of the default.
    pub(super) ratio: f64,
    /// Predicted: the sum of what each does alone, which the triangle inequality makes an upper bound but for what they do to each other.
    pub(super) error: f64,
}

/// The predicted frontier over all choices of one value from each list, quickest first, thinned out to `most` combinations, the ends among
/// them.
pub(super) fn combinations(settings: &[Vec<Alone>], most: usize) -> Vec<Combination> {
    let mut frontier = vec![Combination { settings: Vec::new(), ratio: 1.0, error: 0.0 }];
    for values in settings {
        // What is beaten stays so, whatever follows: each further value multiplies and adds alike.
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

/// Quickest first, each more exact than all before it; of equals the one that changes less.
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
        // "late" costs nothing and is more exact, so that the default of the second is never chosen.
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
