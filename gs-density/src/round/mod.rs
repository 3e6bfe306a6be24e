//! A round of density control, shared by all criteria: prune, let candidates grow up to the budget,
//! reset opacities. Each of these has a file here; so have ranking and drawing of candidates.

mod correction;
mod densify;
mod prune;
mod ranking;
mod reset;
mod sample;
mod schedule;
mod size;

pub use self::{
    correction::OpacityCorrection,
    densify::{Densify, LongAxisSplit, SplitPlacement},
    prune::Prune,
    ranking::{Ranking, WhenFlat, share_of},
    reset::OpacityReset,
    size::SizeThreshold,
};
pub(crate) use self::{
    densify::check_newcomers,
    sample::{add_normalised, sample},
    schedule::scheduled_count,
};

use gs_core::{
    EditPlan, Error, Scene2d,
    edit::{Birth, Change, Removal},
};
use serde::{Deserialize, Serialize};

use crate::observation::{DensityScene, Observation, Rng};

gs_core::impl_with!(Actions);

/// Settings of what is done to the Gaussians, whichever are chosen to grow.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
#[non_exhaustive]
pub struct Actions {
    /// Cloning and splitting.
    pub densify: Densify,
    /// Pruning.
    pub prune: Prune,
    /// Opacity resets.
    pub reset: OpacityReset,
    /// Share of the rounds in which the number of Gaussians grows, 0..=1; later rounds only prune,
    /// without opacity resets.
    /// Default 1.
    #[serde(skip_serializing_if = "is_one")]
    pub growth_fraction: f32,
}

/// Settings files and the digests of settings leave out default values.
fn is_one(share: &f32) -> bool {
    *share == 1.0
}

impl Default for Actions {
    fn default() -> Self {
        Self {
            densify: Densify::default(),
            prune: Prune::default(),
            reset: OpacityReset::default(),
            growth_fraction: 1.0,
        }
    }
}

impl Actions {
    /// Whether the number of Gaussians grows in the round at this progress.
    pub fn grows(&self, progress: f32) -> bool {
        progress <= self.growth_fraction
    }

    /// Checks the ranges of all settings.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first value outside its range.
    pub fn validate(&self) -> Result<(), Error> {
        self.densify.validate()?;
        self.prune.validate()?;
        self.reset.validate()?;
        Error::within("growth-fraction", self.growth_fraction, 0.0..=1.0, "0 to 1")
    }
}

/// A round in progress: pruning is decided, growth is not.
#[derive(Debug, Clone)]
pub struct Round<'a, S = Scene2d> {
    actions: Actions,
    observation: &'a Observation<'a, S>,
    removed: Vec<Removal>,
}

impl<'a, S: DensityScene> Round<'a, S> {
    /// Starts a round by deciding what to prune.
    ///
    /// # Errors
    /// [`Error::Setting`] where a setting of an action is outside its range, [`Error::Length`]
    /// where scene and statistics differ in length.
    pub fn open(actions: &Actions, observation: &'a Observation<'a, S>) -> Result<Self, Error> {
        actions.validate()?;
        observation.check_lengths()?;
        Self::with_removed(actions, observation, actions.prune.removals(observation))
    }

    /// Starts a round that removes what the policy has chosen, where [`Self::open`] would remove
    /// [`Prune::removals`]: `removed`, in ascending order of distinct indices.
    ///
    /// # Errors
    /// As [`Self::open`]; [`Error::Plan`] where `removed` has another order or an index that the
    /// scene does not have.
    pub fn with_removed(
        actions: &Actions,
        observation: &'a Observation<'a, S>,
        removed: Vec<Removal>,
    ) -> Result<Self, Error> {
        actions.validate()?;
        observation.check_lengths()?;
        let len = observation.scene.len();
        if !removed.is_sorted_by(|a, b| a.index < b.index) || removed.last().is_some_and(|r| r.index as usize >= len) {
            let expected = format!("distinct indices below {len} in ascending order");
            return Err(Error::Plan(format!("the removed Gaussians of a round must have {expected}")));
        }
        Ok(Self { actions: *actions, observation, removed })
    }

    /// Indices of the Gaussians that are not pruned, in order.
    pub fn survivors(&self) -> impl Iterator<Item = u32> + '_ {
        let mut removed = self.removed.iter().peekable();
        (0..self.observation.scene.len() as u32).filter(move |&index| removed.next_if(|r| r.index == index).is_none())
    }

    /// Ranks the survivors by a score, a function of the index.
    pub fn rank_by(&self, score: impl Fn(usize) -> f32, when_flat: WhenFlat) -> Ranking {
        Ranking::new(self.survivors().map(|index| (index, score(index as usize))), when_flat)
    }

    /// Ranks the survivors by the mean of the collected statistic, in its unit.
    pub(crate) fn rank_by_statistic(&self, when_flat: WhenFlat) -> Ranking {
        self.rank_by(|index| self.observation.statistics.mean_signal(index), when_flat)
    }

    /// Number of Gaussians that the budget has room for after pruning.
    pub fn room(&self) -> usize {
        let kept = self.observation.scene.len() - self.removed.len();
        self.observation.budget.saturating_sub(kept)
    }

    /// Ends the round: the first of `candidates`, distinct survivors in order of urgency, grow as
    /// far as the budget allows. After [`Actions::growth_fraction`] none grows, and opacities are
    /// not reset.
    pub fn grow(self, candidates: &[u32], rng: &mut Rng) -> EditPlan<S::Gaussian> {
        let (densify, observation) = (self.actions.densify, self.observation);
        let room = if self.actions.grows(observation.progress) { self.room() } else { 0 };
        let chosen = candidates[..candidates.len().min(room)].to_vec();
        self.grow_by(chosen, |index| densify.grow(index, observation, rng))
    }

    /// Ends the round: `two_of` makes two of each of `chosen`, distinct survivors for which there
    /// is room.
    pub(crate) fn grow_by(
        self,
        mut chosen: Vec<u32>,
        mut two_of: impl FnMut(u32) -> (Option<Change<S::Gaussian>>, Birth<S::Gaussian>),
    ) -> EditPlan<S::Gaussian> {
        let grows = self.actions.grows(self.observation.progress);
        // New Gaussians are in the order of their parents, and random numbers do not depend on
        // small changes of the ranking.
        chosen.sort_unstable();
        let opacity_ceiling = self.actions.reset.ceiling(self.observation).filter(|_| grows);
        let mut plan = EditPlan { opacity_ceiling, ..EditPlan::default() };
        for index in chosen {
            let (change, birth) = two_of(index);
            plan.changed.extend(change);
            plan.added.push(birth);
        }
        plan.removed = self.removed;
        plan
    }
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3};
    use gs_core::{DensityStatistics, Gaussian2d, edit::PruneCause};

    use super::*;

    #[test]
    fn a_policy_chooses_what_is_removed_by_distinct_indices_in_order() {
        let gaussian = |opacity_logit| Gaussian2d {
            mean: Vec2::ONE,
            log_scale: Vec2::ONE,
            rotation: 0.0,
            opacity_logit,
            color: Vec3::ONE,
        };
        let scene: Scene2d = [3.0, -9.0, 3.0, 3.0].map(gaussian).into_iter().collect();
        let statistics = DensityStatistics { signal_sum: vec![1.0; 4], visible: vec![1; 4] };
        let observation = Observation {
            scene: &scene,
            statistics: &statistics,
            residual: None,
            evidence: None,
            extent: 32.0,
            step: 99,
            progress: 0.1,
            progress_before: 0.0,
            budget: 10,
        };
        let actions = Actions::default();
        let with = |indices: &[u32]| {
            let removal = |&index: &u32| Removal { index, cause: PruneCause::Unimportant };
            Round::with_removed(&actions, &observation, indices.iter().map(removal).collect())
        };
        let mut removed = actions.prune.removals(&observation);
        assert_eq!(removed, [Removal { index: 1, cause: PruneCause::Transparent }]);
        removed.push(Removal { index: 3, cause: PruneCause::Unimportant });
        let round = Round::with_removed(&actions, &observation, removed.clone()).unwrap();
        assert_eq!((round.survivors().collect::<Vec<_>>(), round.room()), (vec![0, 2], 8));
        assert_eq!(round.grow(&[], &mut Rng::new(0, 0)).removed, removed);
        assert_eq!(with(&[]).unwrap().room(), 6);
        for wrong in [&[3, 1][..], &[1, 1], &[0, 4], &[0, 1, 2, 3, 3]] {
            let error = with(wrong).unwrap_err().to_string();
            assert!(error.contains("distinct indices below 4 in ascending order"), "{error}");
        }
    }
}
