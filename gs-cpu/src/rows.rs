//! Rearranging the rows of an array in place, so that an edit does not hold parameters or moments of
//! all Gaussians twice.

use std::ops::Range;

use gs_core::edit::Source;

/// For each row after an edit, the row before it whose numbers it has.
#[derive(Debug)]
pub(crate) struct Moves {
    /// The former row; `None` for a row of zeros.
    from: Vec<Option<u32>>,
    /// New places of rows that overtake others, which stay in order otherwise.
    overtaking: Vec<usize>,
}

impl Moves {
    /// The moves of an edit; `origin` is the former row of a source.
    pub(crate) fn new(sources: &[Source], origin: impl Fn(&Source) -> Option<u32>) -> Self {
        let stays = |source: &Source| match *source {
            Source::Kept(i) | Source::Changed { before: i, .. } => Some(i),
            Source::Added(_) => None,
        };
        let from: Vec<Option<u32>> = sources.iter().map(origin).collect();
        let mut overtaking = Vec::new();
        // A former row is in order between those of the rows around it that stay.
        let mut next = sources.iter().enumerate().filter_map(|(j, source)| Some((j, stays(source)?))).peekable();
        let mut least = 0;
        for (j, &i) in from.iter().enumerate() {
            while next.next_if(|&(place, _)| place < j).is_some() {}
            let most = next.peek().map_or(u32::MAX, |&(_, i)| i);
            match i {
                Some(i) if (least..=most).contains(&i) => least = i,
                Some(_) => overtaking.push(j),
                None => {}
            }
        }
        Self { from, overtaking }
    }

    /// New and former places of the rows that stay in order, except those that stay where they are.
    fn in_order(&self) -> impl DoubleEndedIterator<Item = (usize, usize)> {
        let moved = self.from.iter().enumerate().filter_map(|(j, i)| Some((j, (*i)? as usize)));
        moved.filter(|&(j, i)| i != j && self.overtaking.binary_search(&j).is_err())
    }

    /// Rearranges an array of rows of `width` numbers.
    ///
    /// Needs the memory of the longer of both arrays, and that of the rows that overtake others.
    pub(crate) fn apply<T: Copy + Default>(&self, rows: &mut Vec<T>, width: usize) {
        let place = |j: usize| -> Range<usize> { j * width..(j + 1) * width };
        let former = |&j: &usize| self.from[j].map(|i| rows[place(i as usize)].to_vec());
        let overtaking: Vec<Option<Vec<T>>> = self.overtaking.iter().map(former).collect();
        let len = self.from.len() * width;
        // `resize` alone may reserve twice the memory.
        rows.reserve_exact(len.saturating_sub(rows.len()));
        rows.resize(len.max(rows.len()), T::default());
        // In ascending order, a move to the left overwrites only rows whose own moves are done. So
        // does a move to the right in descending order.
        for (j, i) in self.in_order().filter(|(j, i)| j < i) {
            rows.copy_within(place(i), j * width);
        }
        for (j, i) in self.in_order().rev().filter(|(j, i)| j > i) {
            rows.copy_within(place(i), j * width);
        }
        for (j, _) in self.from.iter().enumerate().filter(|(_, i)| i.is_none()) {
            rows[place(j)].fill(T::default());
        }
        for (&j, row) in self.overtaking.iter().zip(overtaking) {
            rows[place(j)].copy_from_slice(&row.unwrap_or_default());
        }
        rows.truncate(len);
        rows.shrink_to_fit();
    }
}

#[cfg(test)]
mod tests {
    use gs_core::{
        EditPlan,
        edit::{Birth, Change, Moments, Origin, Place, PruneCause, Removal},
    };
    use proptest::prelude::*;

    use super::*;

    /// A plan for `len` Gaussians whose parts are chosen by `dice`.
    fn plan(len: u32, dice: &[(u8, u32)]) -> EditPlan<u32> {
        let mut plan = EditPlan::default();
        for (index, &(kind, parent)) in (0..len).zip(dice) {
            match kind % 4 {
                0 => plan.removed.push(Removal { index, cause: PruneCause::Transparent }),
                1 => plan.changed.push(Change {
                    index,
                    gaussian: 0,
                    moments: [Moments::Fresh, Moments::Inherit][parent as usize % 2],
                }),
                _ => {}
            }
            let place = [Place::BehindParent, Place::Last, Place::First][kind as usize / 4 % 3];
            let (moments, origin) = (Moments::Inherit, Origin::Clone);
            let parent = (kind < 128).then_some(if kind % 8 < 4 { index } else { parent % len });
            plan.added.extend((kind % 3 > 0).then_some(Birth { gaussian: 0, parent, moments, origin, place }));
        }
        plan
    }

    proptest! {
        #[test]
        fn rows_are_those_of_a_copy(dice in proptest::collection::vec(any::<(u8, u32)>(), 1..40), width in 1usize..4) {
            let len = dice.len() as u32;
            let plan = plan(len, &dice);
            let sources = plan.sources(len as usize).unwrap();
            let before: Vec<u32> = (1..=len * width as u32).collect();
            let kept = |source: &Source| match *source {
                Source::Kept(i) => Some(i),
                _ => None,
            };
            let heirs = |source: &Source| plan.origin(source, Moments::heir_of);
            for origin in [&kept as &dyn Fn(&Source) -> Option<u32>, &heirs] {
                let mut rows = before.clone();
                Moves::new(&sources, origin).apply(&mut rows, width);
                let row = |i: Option<u32>| i.map_or(vec![0; width], |i| before[i as usize * width..][..width].to_vec());
                let copied: Vec<u32> = sources.iter().flat_map(|source| row(origin(source))).collect();
                prop_assert_eq!(rows, copied);
            }
        }
    }
}
