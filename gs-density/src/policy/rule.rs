//! What [`Policy`] must know about a policy besides its plans. A new policy is a file with a type
//! that implements [`ByEvidence`], or [`Rule`] and a [`DensityPolicy`], and an entry in the table of
//! `mod.rs`, the only list of their names.

use gs_core::{EditPlan, Error, edit::Removal, effects::Statistics};

use crate::{
    observation::{DensityPolicy, DensityScene, Evidence, EvidenceRequest, Needs, Observation, Rng},
    round::{Actions, Round},
};

/// Properties of a policy with defaults that fit most policies.
pub(crate) trait Rule {
    /// Checks the ranges of all settings.
    fn validate(&self) -> Result<(), Error>;

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

    /// Changes what differs in 3D, besides the actions.
    fn adapt_to_3d(&mut self) {}
}

/// What follows from the entry of a policy that reads evidence in the table of policies.
pub(crate) trait Listed {
    /// Name in messages.
    const NAME: &'static str;

    /// How Gaussians are cloned, split, pruned and reset.
    fn own_actions(&self) -> &Actions;

    /// [`Self::own_actions`], mutable.
    fn own_actions_mut(&mut self) -> &mut Actions;
}

/// A policy that reads [`Evidence`] while the number of Gaussians grows.
pub(crate) trait ByEvidence: Listed {
    /// Statistic that training must collect.
    const STATISTICS: Statistics;

    /// Checks the ranges of the settings besides the actions.
    fn check(&self) -> Result<(), Error>;

    /// Whether the policy tries to reach the budget.
    fn aims_at_budget(&self) -> bool {
        true
    }

    /// The evidence of a round that needs any.
    fn request(&self) -> EvidenceRequest;

    /// Whether the round after `step` (from 0) needs evidence. By default each round of growth
    /// does.
    fn reads_evidence(&self, _step: u32, progress: f32) -> bool {
        self.own_actions().grows(progress)
    }

    /// The edits of a round that needs evidence.
    fn plan_with<S: DensityScene>(
        &self,
        observation: &Observation<'_, S>,
        evidence: &Evidence,
        rng: &mut Rng,
    ) -> Result<EditPlan<S::Gaussian>, Error>;

    /// What a round without evidence removes, in ascending order of indices. By default it prunes.
    fn removed<S: DensityScene>(&self, observation: &Observation<'_, S>) -> Vec<Removal> {
        self.own_actions().prune.removals(observation)
    }
}

impl<P: ByEvidence> Rule for P {
    fn validate(&self) -> Result<(), Error> {
        self.check()?;
        self.own_actions().validate()
    }

    fn actions(&self) -> Option<&Actions> {
        Some(self.own_actions())
    }

    fn actions_mut(&mut self) -> Option<&mut Actions> {
        Some(self.own_actions_mut())
    }

    fn aims_at_budget(&self) -> bool {
        ByEvidence::aims_at_budget(self)
    }
}

impl<S: DensityScene, P: ByEvidence> DensityPolicy<S> for P {
    fn plan(&self, observation: &Observation<'_, S>, rng: &mut Rng) -> Result<EditPlan<S::Gaussian>, Error> {
        self.validate()?;
        observation.check_lengths()?;
        match self.reads_evidence(observation.step, observation.progress) {
            true => self.plan_with(observation, observation.requested(P::NAME, &self.request())?, rng),
            false => {
                Ok(Round::with_removed(self.own_actions(), observation, self.removed(observation))?.grow(&[], rng))
            }
        }
    }

    fn needs(&self) -> Needs {
        Needs { statistics: P::STATISTICS, evidence: true, ..Needs::default() }
    }

    fn evidence(&self, step: u32, progress: f32) -> Option<EvidenceRequest> {
        self.reads_evidence(step, progress).then(|| self.request())
    }
}

/// Checks that `value` is a percentage.
pub(crate) fn check_percent(value: f32) -> Result<(), Error> {
    Error::within("percent", value, 0.0..=100.0, "0 to 100")
}
