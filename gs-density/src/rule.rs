//! What [`Policy`] must know about a policy besides its plans. A new policy is a file with a type
//! that implements [`Rule`] and a [`DensityPolicy`], and an entry in the table of `policy.rs`.

use gs_core::{EditPlan, Error, effects::Statistics};

use crate::{
    evidence::EvidenceRequest,
    gaussian::DensityScene,
    observation::{DensityPolicy, Observation, Rng},
    round::{Actions, Round},
};

/// The bounds of a policy's growth in one round, for messages.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub struct GrowthLimit {
    /// Largest share of the Gaussians that grows, %; `None` for all.
    pub percent: Option<f32>,
    /// Which Gaussians may grow, as "whose … is at least …"; `None` for any.
    pub condition: Option<String>,
    /// Whether Gaussians grow that satisfy either bound, instead of both.
    pub either: bool,
}

/// Properties of a policy with defaults that fit most policies.
pub(crate) trait Rule {
    /// The actions of a policy that clones and splits.
    fn actions(&self) -> Option<&Actions> {
        None
    }

    /// [`Self::actions`], mutable.
    fn actions_mut(&mut self) -> Option<&mut Actions> {
        None
    }

    /// Whether the policy tries to reach the budget.
    fn aims_at_budget(&self) -> bool {
        true
    }

    /// Which Gaussians may grow in one round.
    fn growth_limit(&self) -> GrowthLimit {
        GrowthLimit::default()
    }

    /// Changes what differs in 3D, besides the actions.
    fn adapt_to_3d(&mut self) {}
}

/// A policy that reads [`Evidence`](crate::Evidence) while the number of Gaussians grows.
pub(crate) trait ByEvidence: Rule {
    /// Name in messages.
    const NAME: &'static str;
    /// Statistic that training must collect.
    const STATISTICS: Statistics;

    /// The actions.
    fn own_actions(&self) -> &Actions;

    /// The evidence of a round that needs any.
    fn request(&self) -> EvidenceRequest;

    /// Whether the round after `step` (from 0) needs evidence. By default each round of growth
    /// does.
    fn reads_evidence(&self, _step: u32, progress: f32) -> bool {
        self.own_actions().grows(progress)
    }

    /// Checks the ranges of all settings.
    fn check(&self) -> Result<(), Error>;

    /// The edits of a round that needs evidence.
    fn plan_with<S: DensityScene>(
        &self,
        observation: &Observation<'_, S>,
        rng: &mut Rng,
    ) -> Result<EditPlan<S::Gaussian>, Error>;

    /// The edits of another round. By default it prunes.
    fn plan_without<S: DensityScene>(
        &self,
        observation: &Observation<'_, S>,
        rng: &mut Rng,
    ) -> Result<EditPlan<S::Gaussian>, Error> {
        Ok(Round::open(self.own_actions(), observation)?.grow(&[], rng))
    }
}

impl<S: DensityScene, P: ByEvidence> DensityPolicy<S> for P {
    fn plan(&self, observation: &Observation<'_, S>, rng: &mut Rng) -> Result<EditPlan<S::Gaussian>, Error> {
        self.check()?;
        observation.check_lengths()?;
        match self.reads_evidence(observation.step, observation.progress) {
            true => self.plan_with(observation, rng),
            false => self.plan_without(observation, rng),
        }
    }

    fn statistics(&self) -> Statistics {
        P::STATISTICS
    }

    fn needs_residual(&self) -> bool {
        false
    }

    fn needs_evidence(&self) -> bool {
        true
    }

    fn evidence(&self, step: u32, progress: f32) -> Option<EvidenceRequest> {
        self.reads_evidence(step, progress).then(|| self.request())
    }
}
