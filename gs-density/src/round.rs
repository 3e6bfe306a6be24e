//! One round of density control: prune, let the candidates grow as far as the budget goes, reset. What all criteria share.

use gs_core::{EditPlan, Error, Scene2d, edit::Removal};
use serde::{Deserialize, Serialize};

use crate::{
    densify::Densify,
    gaussian::DensityScene,
    observation::{Observation, Rng},
    prune::Prune,
    ranking::{Ranking, WhenFlat},
    reset::OpacityReset,
};

/// What is done to the Gaussians, whoever is chosen to grow.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub struct Actions {
    /// How one becomes two.
    pub densify: Densify,
    /// What is pruned.
    pub prune: Prune,
    /// When opacities are reset.
    pub reset: OpacityReset,
}

impl Actions {
    /// Fails where a number is outside its range.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first offender.
    pub fn validate(&self) -> Result<(), Error> {
        self.densify.validate()?;
        self.prune.validate()?;
        self.reset.validate()
    }
}

/// A round under way: what must go is known, what grows is yet to be chosen.
#[derive(Debug, Clone)]
pub struct Round<'a, S = Scene2d> {
    actions: Actions,
    observation: &'a Observation<'a, S>,
    removed: Vec<Removal>,
}

impl<'a, S: DensityScene> Round<'a, S> {
    /// Starts with what must go.
    ///
    /// # Errors
    /// [`Error::Setting`] where an action's number is outside its range, [`Error::Length`] where scene and statistics differ in
    /// length.
    pub fn open(actions: &Actions, observation: &'a Observation<'a, S>) -> Result<Self, Error> {
        actions.validate()?;
        observation.check_lengths()?;
        let removed = actions.prune.removals(observation);
        Ok(Self { actions: *actions, observation, removed })
    }

    /// The survivors' indices, in order.
    pub fn survivors(&self) -> impl Iterator<Item = u32> + '_ {
        let mut removed = self.removed.iter().peekable();
        (0..self.observation.scene.len() as u32).filter(move |&index| removed.next_if(|r| r.index == index).is_none())
    }

    /// The survivors ranked by a score of the policy's own, a function of the index.
    pub fn rank_by(&self, score: impl Fn(usize) -> f32, when_flat: WhenFlat) -> Ranking {
        Ranking::new(self.survivors().map(|index| (index, score(index as usize))), when_flat)
    }

    /// The survivors ranked by the mean of the statistic that was collected, in its unit.
    pub fn rank_by_statistic(&self, when_flat: WhenFlat) -> Ranking {
        self.rank_by(|index| self.observation.statistics.mean_gradient(index), when_flat)
    }

    /// How many more Gaussians the budget has room for once what must go has gone.
    pub fn room(&self) -> usize {
        let kept = self.observation.scene.len() - self.removed.len();
        self.observation.budget.saturating_sub(kept)
    }

    /// Ends the round: of `candidates`, distinct survivors with the most urgent first, as many grow as the budget has room for.
    pub fn grow(self, candidates: &[u32], rng: &mut Rng) -> EditPlan<S::Gaussian> {
        let mut chosen = candidates[..candidates.len().min(self.room())].to_vec();
        // Children lie in the order of their parents, and the random numbers don't depend on small changes of the ranking.
        chosen.sort_unstable();
        let mut plan =
            EditPlan { opacity_ceiling: self.actions.reset.ceiling(self.observation), ..EditPlan::default() };
        for index in chosen {
            let (change, birth) = self.actions.densify.grow(index, self.observation, rng);
            plan.changed.extend(change);
            plan.added.push(birth);
        }
        plan.removed = self.removed;
        plan
    }
}
