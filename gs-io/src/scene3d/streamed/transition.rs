//! Transitions between levels of detail: the level before fades out while the next one fades in.

/// How long a cell takes from one level to another, s.
const SECONDS: f64 = 0.25;

/// The levels that cells show, and those that they come from.
#[derive(Debug, Default)]
pub(super) struct Transition {
    cells: Vec<Change>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Change {
    /// `None` for a cell that shows nothing.
    level: Option<usize>,
    /// The level before, and when it began to fade out, s.
    before: Option<(usize, f64)>,
}

impl Transition {
    /// What the cells show at this time, s, on their way to these levels: cells, levels, and the shares of their
    /// opacities, above 0 and at most 1.
    ///
    /// Cells out of sight, and those that showed nothing, change at once. A cell ends a transition before it begins
    /// another.
    pub(super) fn at(
        &mut self,
        levels: &[Option<usize>],
        in_sight: impl Fn(usize) -> bool,
        seconds: f64,
    ) -> Vec<(usize, usize, f32)> {
        self.cells.resize(levels.len(), Change::default());
        let mut shown = Vec::new();
        for (cell, (change, &wanted)) in self.cells.iter_mut().zip(levels).enumerate() {
            let fades = in_sight(cell);
            change.before = change.before.filter(|(_, began)| fades && seconds - began < SECONDS);
            if change.before.is_none() && change.level != wanted {
                change.before = change.level.filter(|_| fades).map(|level| (level, seconds));
                change.level = wanted;
            }
            let share = change.before.map_or(1.0, |(_, began)| ((seconds - began) / SECONDS) as f32);
            let before = change.before.map(|(level, _)| (cell, level, 1.0 - share));
            shown.extend(before.into_iter().chain(change.level.map(|level| (cell, level, share))));
        }
        shown.retain(|(.., share)| *share > 0.0);
        shown
    }

    /// Cells and levels that are shown, or are about to be.
    pub(super) fn levels(&self) -> impl Iterator<Item = (usize, usize)> {
        let of = |(cell, change): (usize, &Change)| {
            [change.level, change.before.map(|(level, _)| level)].map(|level| Some((cell, level?)))
        };
        self.cells.iter().enumerate().flat_map(of).flatten()
    }

    pub(super) fn is_under_way(&self) -> bool {
        self.cells.iter().any(|change| change.before.is_some())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_level_fades_out_while_the_next_fades_in_and_no_cell_changes_twice_at_once() {
        let mut transition = Transition::default();
        let mut at = |levels: [Option<usize>; 3], share: f64| {
            let shown = transition.at(&levels, |cell| cell != 2, 7.0 + share * SECONDS);
            (shown, transition.is_under_way())
        };
        let [first, next, last] = [[Some(5), None, Some(5)], [Some(2), Some(4), Some(1)], [Some(3), Some(4), None]];
        assert_eq!(at(first, 0.0), (vec![(0, 5, 1.0), (2, 5, 1.0)], false), "the first levels come at once");
        // Cell 1 showed nothing, and cell 2 is out of sight.
        assert_eq!(at(next, 1.0), (vec![(0, 5, 1.0), (1, 4, 1.0), (2, 1, 1.0)], true));
        assert_eq!(at(next, 1.25), (vec![(0, 5, 0.75), (0, 2, 0.25), (1, 4, 1.0), (2, 1, 1.0)], true));
        assert_eq!(
            at(last, 1.5),
            (vec![(0, 5, 0.5), (0, 2, 0.5), (1, 4, 1.0)], true),
            "towards what was wanted before"
        );
        assert_eq!(at(last, 2.0), (vec![(0, 2, 1.0), (1, 4, 1.0)], true));
        assert_eq!(at(last, 2.5).0, [(0, 2, 0.5), (0, 3, 0.5), (1, 4, 1.0)]);
        assert_eq!(at(last, 9.0), (vec![(0, 3, 1.0), (1, 4, 1.0)], false));
    }

    #[test]
    fn what_a_transition_still_shows_is_known() {
        let mut transition = Transition::default();
        transition.at(&[Some(5), Some(1)], |_| true, 0.0);
        transition.at(&[Some(2), Some(1)], |_| true, 1.0);
        assert_eq!(transition.levels().collect::<Vec<_>>(), [(0, 2), (0, 5), (1, 1)]);
    }
}
