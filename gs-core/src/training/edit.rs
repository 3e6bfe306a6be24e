//! Plans of edits to a set of Gaussians, and the one rule by which parameters, moments and
//! statistics follow them.

use std::fmt::Debug;

use serde::{Deserialize, Serialize};

use crate::error::Error;

/// Why a Gaussian was removed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum PruneCause {
    /// An opacity below ε_α (paper §2.2.3).
    Transparent,
    /// A size larger than the policy allows.
    TooLarge,
    /// A parameter that is NaN or infinite.
    NotFinite,
    /// A contribution among the least, or none to any training image.
    Unimportant,
}

/// How a Gaussian was added.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Origin {
    /// A copy of its parent (paper §2.2.2, under-reconstruction).
    Clone,
    /// A smaller Gaussian, one of those that replace their parent (paper §2.2.2,
    /// over-reconstruction).
    Split,
    /// A new Gaussian without a parent, placed where the residual is large.
    Seed,
}

/// What an edit does with a Gaussian's Adam moments and step count. Exhaustive: a backend must
/// handle each value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Moments {
    /// Start at zero, step count included, so that Adam corrects their bias afresh.
    #[default]
    Fresh,
    /// Moments start at zero, but the step count is the parent's, so that their bias is not
    /// corrected. Without a parent the same as [`Self::Fresh`].
    ///
    /// Until the second moments have filled, steps are longer than the learning rate: at first 3
    /// times, after 10 steps 6 times, after 200 twice (for β₁ = 0.9, β₂ = 0.999). *Source:* 3DGS,
    /// whose optimizer counts the steps of all Gaussians together.
    Zeroed,
    /// Moments and step count of the parent (of itself, for a change in place).
    Inherit,
}

impl Moments {
    /// The Gaussian whose moments are inherited, for a Gaussian that comes from `from`; `None`
    /// where they start at zero.
    pub fn heir_of(self, from: Option<u32>) -> Option<u32> {
        from.filter(|_| self == Self::Inherit)
    }

    /// The Gaussian whose step count is continued, for a Gaussian that comes from `from`; `None`
    /// where it starts at zero.
    pub fn counts_on_from(self, from: Option<u32>) -> Option<u32> {
        from.filter(|_| self != Self::Fresh)
    }
}

/// Position of a new Gaussian in the arrays. Under [`Blend::Over`](crate::effects::Blend::Over)
/// with [`Order::Index`](crate::effects::Order::Index) that is its depth; otherwise it only changes
/// indices.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Place {
    /// Right behind its parent (or the parent's former place, if it is removed), as copies in 3D
    /// are; without a parent: last.
    #[default]
    BehindParent,
    /// Behind all others.
    Last,
    /// Before all others.
    First,
}

/// A Gaussian to remove.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Removal {
    /// Index before the edit.
    pub index: u32,
    /// Reason.
    pub cause: PruneCause,
}

/// A Gaussian to change in place.
#[derive(Debug, Clone, PartialEq)]
pub struct Change<G> {
    /// Index before the edit.
    pub index: u32,
    /// New parameters.
    pub gaussian: G,
    /// What the edit does with the Gaussian's moments.
    pub moments: Moments,
}

/// A Gaussian to add.
#[derive(Debug, Clone, PartialEq)]
pub struct Birth<G> {
    /// Parameters.
    pub gaussian: G,
    /// Index, before the edit, of the parent, from which the statistics and, if inherited, the
    /// moments come.
    pub parent: Option<u32>,
    /// What the Gaussian's moments start from; without a parent always [`Moments::Fresh`].
    pub moments: Moments,
    /// How the Gaussian is added.
    pub origin: Origin,
    /// Position of the Gaussian in the arrays.
    pub place: Place,
}

impl<G> Birth<G> {
    /// A seed: a new Gaussian without a parent, before all others.
    pub fn seed(gaussian: G) -> Self {
        Self { gaussian, parent: None, moments: Moments::Fresh, origin: Origin::Seed, place: Place::First }
    }
}

/// What an edit does with the statistics of all Gaussians.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum AfterEdit {
    /// All statistics start at zero again (what 3DGS does).
    #[default]
    Restart,
    /// Statistics stay with their Gaussians; new Gaussians have their parent's, or zero.
    Keep,
}

/// The edits that a density policy wants.
///
/// Gaussians that stay keep their order. Added ones stand at their [`Place`], in the order of the
/// plan.
#[derive(Debug, Clone, PartialEq)]
pub struct EditPlan<G> {
    /// Gaussians to remove.
    pub removed: Vec<Removal>,
    /// Gaussians to change in place. None of them may be removed, too.
    pub changed: Vec<Change<G>>,
    /// Gaussians to add. Their parents may be removed in the same plan.
    pub added: Vec<Birth<G>>,
    /// Ceiling to which every opacity is lowered after all else; the moments of opacities are then
    /// zeroed (paper §2.2.3).
    pub opacity_ceiling: Option<f32>,
    /// What the edit does with the statistics.
    pub statistics: AfterEdit,
    /// Number of Gaussians, the first of the scene, that the edit leaves as they are. Added ones stand behind
    /// them.
    pub fixed: u32,
}

impl<G> Default for EditPlan<G> {
    fn default() -> Self {
        Self {
            removed: Vec::new(),
            changed: Vec::new(),
            added: Vec::new(),
            opacity_ceiling: None,
            statistics: AfterEdit::Restart,
            fixed: 0,
        }
    }
}

/// Where a slot of the edited arrays comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// The Gaussian at this index before the edit, unchanged.
    Kept(u32),
    /// The Gaussian at index `before`, replaced by `plan.changed[change]`.
    Changed {
        /// Index before the edit.
        before: u32,
        /// Index into `plan.changed`.
        change: u32,
    },
    /// `plan.added` at this index.
    Added(u32),
}

/// Numbers of Gaussians that a plan adds and removes. Exhaustive: tables have a column for each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct EditCounts {
    /// Copies added.
    pub cloned: u32,
    /// Gaussians added by splitting, beyond the ones they replace.
    pub split: u32,
    /// Gaussians added where the residual is large.
    pub seeded: u32,
    /// Gaussians removed as transparent.
    pub pruned_transparent: u32,
    /// Gaussians removed as too large.
    pub pruned_too_large: u32,
    /// Gaussians removed as not finite.
    pub pruned_not_finite: u32,
    /// Gaussians removed as contributing least.
    pub pruned_unimportant: u32,
}

impl EditCounts {
    /// Number of Gaussians removed.
    pub fn pruned(&self) -> u32 {
        self.pruned_transparent + self.pruned_too_large + self.pruned_not_finite + self.pruned_unimportant
    }

    /// Number of Gaussians added.
    pub fn added(&self) -> u32 {
        self.cloned + self.split + self.seeded
    }

    /// Adds the counts of another plan.
    pub fn accumulate(&mut self, other: &Self) {
        self.cloned += other.cloned;
        self.split += other.split;
        self.seeded += other.seeded;
        self.pruned_transparent += other.pruned_transparent;
        self.pruned_too_large += other.pruned_too_large;
        self.pruned_not_finite += other.pruned_not_finite;
        self.pruned_unimportant += other.pruned_unimportant;
    }
}

impl<G> EditPlan<G> {
    /// Whether the plan leaves all Gaussians as they are.
    pub fn is_empty(&self) -> bool {
        self.removed.is_empty() && self.changed.is_empty() && self.added.is_empty() && self.opacity_ceiling.is_none()
    }

    /// Returns this plan of a scene's last Gaussians as one of the whole scene, whose first `fixed` it leaves as
    /// they are.
    #[must_use]
    pub fn behind(mut self, fixed: u32) -> Self {
        self.removed.iter_mut().for_each(|removal| removal.index += fixed);
        self.changed.iter_mut().for_each(|change| change.index += fixed);
        self.added.iter_mut().filter_map(|birth| birth.parent.as_mut()).for_each(|parent| *parent += fixed);
        self.fixed += fixed;
        self
    }

    /// Number of Gaussians after the edit, from their number before.
    pub fn len_after(&self, len: usize) -> usize {
        len - self.removed.len() + self.added.len()
    }

    /// Numbers of Gaussians that the plan adds and removes.
    pub fn counts(&self) -> EditCounts {
        let mut counts = EditCounts::default();
        for birth in &self.added {
            match birth.origin {
                Origin::Clone => counts.cloned += 1,
                Origin::Split => counts.split += 1,
                Origin::Seed => counts.seeded += 1,
            }
        }
        for removal in &self.removed {
            match removal.cause {
                PruneCause::Transparent => counts.pruned_transparent += 1,
                PruneCause::TooLarge => counts.pruned_too_large += 1,
                PruneCause::NotFinite => counts.pruned_not_finite += 1,
                PruneCause::Unimportant => counts.pruned_unimportant += 1,
            }
        }
        counts
    }

    /// Where each slot after the edit of `len` Gaussians comes from, `[len_after]`.
    ///
    /// Every array of splats (parameters, moments, statistics) is rebuilt by it.
    ///
    /// # Errors
    /// [`Error::Plan`] where an index is out of range, of a fixed Gaussian, or occurs twice among `removed`
    /// and `changed`.
    pub fn sources(&self, len: usize) -> Result<Vec<Source>, Error> {
        let mut slots: Vec<Option<Source>> = (0..len as u32).map(|i| Some(Source::Kept(i))).collect();
        let changed = self.changed.iter().map(|change| change.index);
        let parents = self.added.iter().filter_map(|birth| birth.parent);
        let edited = changed.chain(self.removed.iter().map(|removal| removal.index)).chain(parents);
        if let Some(index) = edited.filter(|&index| index < self.fixed).min() {
            return Err(Error::Plan(format!("Gaussian {index} is fixed, as the first {} are", self.fixed)));
        }
        for (change, c) in self.changed.iter().enumerate() {
            let slot = slot_of(&mut slots, c.index)?;
            if *slot != Some(Source::Kept(c.index)) {
                return Err(Error::Plan(format!("Gaussian {} is changed twice", c.index)));
            }
            *slot = Some(Source::Changed { before: c.index, change: change as u32 });
        }
        for r in &self.removed {
            let slot = slot_of(&mut slots, r.index)?;
            if *slot != Some(Source::Kept(r.index)) {
                return Err(Error::Plan(format!("Gaussian {} is removed twice, or changed and removed", r.index)));
            }
            *slot = None;
        }
        if let Some(parent) = self.added.iter().filter_map(|b| b.parent).find(|&p| p as usize >= len) {
            return Err(Error::Plan(format!("parent {parent} of an added Gaussian is not among the {len}")));
        }
        Ok(self.arranged(slots))
    }

    /// The Gaussians that stay, with the added ones at their places.
    fn arranged(&self, slots: Vec<Option<Source>>) -> Vec<Source> {
        let place =
            |b: &Birth<G>| if b.parent.is_none() && b.place == Place::BehindParent { Place::Last } else { b.place };
        let all_at = |wanted: Place| {
            let births = self.added.iter().enumerate().filter(move |(_, b)| place(b) == wanted);
            births.map(|(k, _)| Source::Added(k as u32))
        };
        let mut behind: Vec<(u32, u32)> = (self.added.iter().enumerate())
            .filter(|(_, b)| b.place == Place::BehindParent)
            .filter_map(|(k, b)| Some((b.parent?, k as u32)))
            .collect();
        behind.sort_unstable();
        let mut behind = behind.into_iter().peekable();
        let (fixed, others) = slots.split_at((self.fixed as usize).min(slots.len()));
        let mut sources: Vec<Source> = fixed.iter().copied().flatten().chain(all_at(Place::First)).collect();
        for (index, slot) in (fixed.len()..).zip(others) {
            sources.extend(slot);
            while let Some((_, k)) = behind.next_if(|&(parent, _)| parent as usize == index) {
                sources.push(Source::Added(k));
            }
        }
        sources.extend(all_at(Place::Last));
        sources
    }

    /// Rebuilds one array of parameters: `fresh(gaussian)` is the value of a changed or added
    /// Gaussian.
    pub fn gather<T: Clone>(&self, sources: &[Source], before: &[T], fresh: impl Fn(&G) -> T) -> Vec<T> {
        sources
            .iter()
            .map(|source| match *source {
                Source::Kept(i) => before[i as usize].clone(),
                Source::Changed { change, .. } => fresh(&self.changed[change as usize].gaussian),
                Source::Added(k) => fresh(&self.added[k as usize].gaussian),
            })
            .collect()
    }

    /// Rebuilds one array of Adam moments; those that start at zero are `T::default()`.
    pub fn gather_moments<T: Clone + Default>(&self, sources: &[Source], before: &[T]) -> Vec<T> {
        self.gather_from(sources, before, Moments::heir_of)
    }

    /// Rebuilds the array of step counts.
    pub fn gather_steps(&self, sources: &[Source], before: &[u32]) -> Vec<u32> {
        self.gather_from(sources, before, Moments::counts_on_from)
    }

    fn gather_from<T: Clone + Default>(
        &self,
        sources: &[Source],
        before: &[T],
        from: fn(Moments, Option<u32>) -> Option<u32>,
    ) -> Vec<T> {
        let of = |index: Option<u32>| index.map_or_else(T::default, |i| before[i as usize].clone());
        sources.iter().map(|source| of(self.origin(source, from))).collect()
    }

    /// The Gaussian, before the edit, from which a slot takes moments ([`Moments::heir_of`]) or its
    /// step count ([`Moments::counts_on_from`]).
    pub fn origin(&self, source: &Source, from: fn(Moments, Option<u32>) -> Option<u32>) -> Option<u32> {
        match *source {
            Source::Kept(i) => Some(i),
            Source::Changed { before, change } => from(self.changed[change as usize].moments, Some(before)),
            Source::Added(k) => from(self.added[k as usize].moments, self.added[k as usize].parent),
        }
    }

    /// Rebuilds one array of statistics.
    pub fn gather_statistics<T: Clone + Default>(&self, sources: &[Source], before: &[T]) -> Vec<T> {
        if self.statistics == AfterEdit::Restart {
            return vec![T::default(); sources.len()];
        }
        let of = |i: u32| before[i as usize].clone();
        sources
            .iter()
            .map(|source| match *source {
                Source::Kept(i) | Source::Changed { before: i, .. } => of(i),
                Source::Added(k) => self.added[k as usize].parent.map_or_else(T::default, of),
            })
            .collect()
    }
}

fn slot_of(slots: &mut [Option<Source>], index: u32) -> Result<&mut Option<Source>, Error> {
    let len = slots.len();
    slots.get_mut(index as usize).ok_or_else(|| Error::Plan(format!("Gaussian {index} is not among the {len}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn birth(gaussian: char, parent: Option<u32>, moments: Moments) -> Birth<char> {
        Birth { gaussian, parent, moments, origin: Origin::Clone, place: Place::Last }
    }

    #[test]
    fn everything_follows_its_gaussian() {
        let plan = EditPlan {
            removed: vec![Removal { index: 1, cause: PruneCause::Transparent }],
            changed: vec![Change { index: 2, gaussian: 'C', moments: Moments::Inherit }],
            added: vec![birth('x', Some(1), Moments::Inherit), birth('y', None, Moments::Inherit)],
            opacity_ceiling: None,
            statistics: AfterEdit::Keep,
            fixed: 0,
        };
        let sources = plan.sources(4).unwrap();
        assert_eq!(plan.gather(&sources, &['a', 'b', 'c', 'd'], |&g| g), ['a', 'C', 'd', 'x', 'y']);
        assert_eq!(plan.gather_moments(&sources, &[1, 2, 3, 4]), [1, 3, 4, 2, 0]);
        assert_eq!(plan.gather_statistics(&sources, &[1, 2, 3, 4]), [1, 3, 4, 2, 0]);
        assert_eq!(plan.len_after(4), 5);
    }

    #[test]
    fn the_added_stand_where_they_are_put() {
        let mut added = vec![
            birth('y', Some(0), Moments::Fresh),
            birth('b', Some(1), Moments::Fresh),
            birth('a', Some(0), Moments::Fresh),
            birth('z', None, Moments::Fresh),
            birth('f', Some(1), Moments::Fresh),
        ];
        for k in [1, 2, 3] {
            added[k].place = Place::BehindParent;
        }
        added[4].place = Place::First;
        let removed = vec![Removal { index: 1, cause: PruneCause::Transparent }];
        let plan = EditPlan { removed, added, ..Default::default() };
        let sources = plan.sources(3).unwrap();
        let after = plan.gather(&sources, &['0', '1', '2'], |&g| g);
        assert_eq!(after, ['f', '0', 'a', 'b', '2', 'y', 'z']);
    }

    #[test]
    fn fixed_gaussians_stay_in_front() {
        let mut added = vec![birth('x', Some(1), Moments::Fresh), birth('f', None, Moments::Fresh)];
        (added[0].place, added[1].place) = (Place::BehindParent, Place::First);
        let removed = vec![Removal { index: 0, cause: PruneCause::Transparent }];
        let plan = EditPlan { removed, added, ..Default::default() }.behind(2);
        let after = plan.gather(&plan.sources(4).unwrap(), &['0', '1', 'a', 'b'], |&g| g);
        assert_eq!(after, ['0', '1', 'f', 'b', 'x']);
        for (index, parent) in [(1, 3), (2, 1)] {
            let mut wrong = plan.clone();
            (wrong.removed[0].index, wrong.added[0].parent) = (index, Some(parent));
            assert!(matches!(wrong.sources(4), Err(Error::Plan(_))), "{index} {parent}");
        }
    }

    #[test]
    fn contradictions_are_refused() {
        let removal = Removal { index: 1, cause: PruneCause::NotFinite };
        let twice = EditPlan::<char> { removed: vec![removal, removal], ..Default::default() };
        assert!(twice.sources(3).is_err());
        assert!(twice.sources(1).is_err());
        let orphan = EditPlan { added: vec![birth('x', Some(9), Moments::Fresh)], ..Default::default() };
        assert!(orphan.sources(3).is_err());
    }
}
