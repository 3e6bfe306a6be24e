//! Improved-GS: growth by the edges that a Gaussian draws, and pruning of Gaussians that recover
//! slowly from an opacity reset.

use gs_core::{
    EditPlan, Error,
    edit::{PruneCause, Removal},
    effects::Statistics,
};
use serde::{Deserialize, Serialize};

use super::{
    partial,
    rule::{ByEvidence, check_percent},
};
use crate::{
    observation::{DensityScene, Evidence, EvidenceRequest, Observation, Rng},
    round::{Actions, Densify, LongAxisSplit, Round, WhenFlat, add_normalised, sample, share_of},
};

gs_core::impl_with!(ImprovedGs);

/// Growth by the edges that a Gaussian draws, along a schedule of counts that ends at the budget
/// (*source:* Improved-GS, Deng et al. 2025). For training in 3D.
///
/// - Gaussians whose absolute gradient reaches the threshold are split along their long axis. They
///   are drawn in proportion to their edge score: the sum, over the pixels of several views, of the
///   target's edges times the Gaussian's blending weight, divided by its median in each view.
/// - With p the progress of growth and B the budget, there are at most B √p Gaussians.
/// - Some steps after each of the first opacity resets, the Gaussians with the lowest opacity are
///   removed, because they have recovered least.
///
/// The published gradients over several views for one step are left out, and so are the published
/// changes in the last rounds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
#[non_exhaustive]
pub struct ImprovedGs {
    /// Number of training views for the score, drawn again in each round; 0 for all. Default 10.
    pub views: u32,
    /// Least absolute gradient of a Gaussian that grows, normalised device units; not negative.
    /// Default 0.0003.
    pub threshold: f32,
    /// Steps from an opacity reset to the removal of the Gaussians that have recovered least; a
    /// multiple of the steps between two rounds. Default 300.
    pub recovery_steps: u32,
    /// Share of the Gaussians that is removed after a reset, 0..=100 %. Default 20.
    pub recovery_percent: f32,
    /// Number of opacity resets, from the first, that are followed by such a removal. Default 2.
    pub recovery_resets: u32,
    /// How Gaussians are split, pruned and reset. Default: instead of clone and split, a
    /// [`LongAxisSplit`] by 1.35 standard deviations, of length 0.55, width 0.893 and opacity 0.6.
    #[serde(deserialize_with = "partial::read::<ImprovedGs, _>", serialize_with = "partial::write::<ImprovedGs, _>")]
    pub actions: Actions,
}

impl Default for ImprovedGs {
    fn default() -> Self {
        let densify = Densify::into_halves(LongAxisSplit::IMPROVED_GS);
        Self {
            views: 10,
            threshold: 3e-4,
            recovery_steps: 300,
            recovery_percent: 20.0,
            recovery_resets: 2,
            actions: Actions { densify, ..Actions::default() },
        }
    }
}

impl ImprovedGs {
    /// The edge score of every Gaussian, `[N]`.
    fn scores(evidence: &Evidence, len: usize) -> Vec<f64> {
        let mut scores = vec![0.0; len];
        for view in &evidence.views {
            add_normalised(&mut scores, 1.0, |index| view.blended.error[index]);
        }
        scores
    }

    /// Whether the round after `step` (from 0) removes the Gaussians that have recovered least.
    pub fn recovers_after(&self, step: u32) -> bool {
        let (steps, every) = (u64::from(step) + 1, u64::from(self.actions.reset.every));
        let Some(since) = steps.checked_sub(u64::from(self.recovery_steps)).filter(|_| every > 0) else { return false };
        since.is_multiple_of(every) && (1..=u64::from(self.recovery_resets)).contains(&(since / every))
    }
}

impl ByEvidence for ImprovedGs {
    const STATISTICS: Statistics = Statistics::AbsoluteGradient;

    fn check(&self) -> Result<(), Error> {
        Error::within("threshold", self.threshold, 0.0.., "0 or more")?;
        check_percent(self.recovery_percent)
    }

    fn request(&self) -> EvidenceRequest {
        EvidenceRequest { views: self.views, l1: 0.0, edges: 1.0, blended: true, ..EvidenceRequest::default() }
    }

    fn plan_with<S: DensityScene>(
        &self,
        observation: &Observation<'_, S>,
        evidence: &Evidence,
        rng: &mut Rng,
    ) -> Result<EditPlan<S::Gaussian>, Error> {
        let round = Round::with_removed(&self.actions, observation, self.removed(observation))?;
        let scores = Self::scores(evidence, observation.scene.len());
        let grown = (f64::from(observation.progress) / f64::from(self.actions.growth_fraction)).clamp(0.0, 1.0);
        let wanted = (observation.budget as f64 * grown.sqrt()) as usize;
        let quota = wanted.saturating_sub(round.survivors().count());
        let ranking = round.rank_by_statistic(WhenFlat::Nothing);
        let candidates = ranking.at_least(self.threshold).iter().map(|&index| (index, scores[index as usize]));
        let chosen = sample(candidates, quota, rng);
        Ok(round.grow(&chosen, rng))
    }

    /// Those of every round; after a reset also those that have recovered least.
    fn removed<S: DensityScene>(&self, observation: &Observation<'_, S>) -> Vec<Removal> {
        let mut removed = self.actions.prune.removals(observation);
        if !self.recovers_after(observation.step) || !observation.scene.has_opacity() {
            return removed;
        }
        let mut gone = removed.iter().map(|r| r.index).peekable();
        let len = observation.scene.len() as u32;
        let mut left: Vec<u32> = (0..len).filter(|&index| gone.next_if_eq(&index).is_none()).collect();
        let opacity = |index: u32| observation.scene.opacity_logit(index as usize);
        left.sort_by(|&a, &b| opacity(a).total_cmp(&opacity(b)));
        left.truncate(share_of(left.len(), self.recovery_percent));
        removed.extend(left.into_iter().map(|index| Removal { index, cause: PruneCause::Unimportant }));
        removed.sort_unstable_by_key(|r| r.index);
        removed
    }
}
