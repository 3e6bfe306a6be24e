//! MRNF: growth in proportion to errors that are normalised by visibility, paced to reach the
//! budget.

use gs_core::{EditPlan, Error, effects::Statistics, sigmoid};
use serde::{Deserialize, Serialize};

use super::{
    partial,
    rule::{ByEvidence, check_percent},
};
use crate::{
    observation::{DensityScene, Evidence, EvidenceRequest, Observation, Rng},
    round::{Actions, Densify, LongAxisSplit, OpacityReset, Prune, Round, sample, share_of},
};

gs_core::impl_with!(Mrnf);

/// Growth in proportion to errors that are normalised by visibility, paced to reach the budget,
/// with replacement of pruned Gaussians. For training in 3D.
///
/// This follows the strategy MRNF of LichtFeld Studio, which has no publication. The numbers are
/// those of its settings file for evaluation of August 2026, and the rules those of the source that
/// reads this file, except for the choices named below.
///
/// - A Gaussian's error in a view is Σ w e over the pixels, with its blending weight w and the
///   pixel's error e; its visibility is Σ w. Both are taken from several training views of the
///   round. Its *score* is the largest error / visibility^[`Self::power`] over the views.
/// - Gaussians below the pruning opacity are removed. As many others, drawn in proportion to their
///   opacity among those that some view shows, are split in their place, also after growth.
/// - Gaussians with an error of at least [`Self::error`] in some view are candidates. In a round of
///   growth, [`Self::percent`] % of their number are split, those in place of removed ones included,
///   but no more than an even pace to the budget allows: the missing Gaussians divided by the later
///   rounds of growth. The others are drawn among the candidates in proportion to their score.
/// - Growth and replacement split a Gaussian side by side along its long axis.
///
/// Choices of this project: the power is one of the visibility; shares are rounded up, so that few
/// Gaussians grow, too; e is the mean absolute difference, scaled to 0..=1 within its view (the
/// source has a structural error), so the bound of candidates is in another unit; and evidence is
/// gathered in the round, not in the steps before it. Left out: edge guidance, decay of opacities
/// and scales after a round, and noise on the means. The source adds points in the far field during
/// growth; here the initialization places them (`init.far-points`), for every policy.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
#[non_exhaustive]
pub struct Mrnf {
    /// Number of training views for the scores, drawn again in each round; 0 for all. Default 10
    /// (this project's choice).
    pub views: u32,
    /// Least error of a candidate in some view, px; not negative. Default 0.003.
    pub error: f32,
    /// Power of the visibility by which an error is divided, 0..=1. Default 0.75.
    pub power: f32,
    /// Share of the candidates that grows in a round, 0..=100 %. Default 7.
    pub percent: f32,
    /// How Gaussians are split and pruned. Default: splits along the long axis with the numbers of
    /// Improved-GS, pruning below an opacity of 1/255, no opacity resets, and growth in the first
    /// 150/285 of the rounds (until step 15,000, with rounds until 28,500).
    #[serde(deserialize_with = "partial::read::<Mrnf, _>", serialize_with = "partial::write::<Mrnf, _>")]
    pub actions: Actions,
}

impl Default for Mrnf {
    fn default() -> Self {
        let actions = Actions {
            densify: Densify::into_halves(LongAxisSplit::IMPROVED_GS),
            prune: Prune { opacity: 1.0 / 255.0, ..Prune::default() },
            reset: OpacityReset::NEVER,
            growth_fraction: 150.0 / 285.0,
            ..Actions::default()
        };
        Self { views: 10, error: 0.003, power: 0.75, percent: 7.0, actions }
    }
}

/// The evidence about all Gaussians, `[N]`.
struct Scores {
    /// Largest error over the views, px.
    error: Vec<f32>,
    /// Largest error / visibility^power.
    score: Vec<f64>,
}

impl Mrnf {
    fn scores(&self, evidence: &Evidence, len: usize) -> Scores {
        let (mut error, mut score) = (vec![0.0f32; len], vec![0.0f64; len]);
        for view in &evidence.views {
            for (index, (&of_view, &visibility)) in view.blended.error.iter().zip(&view.blended.pixels).enumerate() {
                if visibility > 0.0 && of_view > 0.0 {
                    error[index] = error[index].max(of_view);
                    let ratio = f64::from(of_view) / f64::from(visibility).powf(f64::from(self.power));
                    score[index] = score[index].max(ratio);
                }
            }
        }
        Scores { error, score }
    }

    /// Number of Gaussians that are split in a round of growth, those in place of removed ones
    /// included, with `candidates` and room for `missing`.
    fn pace<S: DensityScene>(&self, observation: &Observation<'_, S>, candidates: usize, missing: usize) -> usize {
        let Observation { progress, progress_before, .. } = *observation;
        if !self.actions.grows(progress) {
            return 0;
        }
        // The rounds after this one that still grow.
        let left = (f64::from(self.actions.growth_fraction - progress)
            / f64::from(progress - progress_before).max(1e-9)
            + 1e-3)
            .floor()
            .max(1.0);
        share_of(candidates, self.percent).min((missing as f64 / left).ceil() as usize)
    }
}

impl ByEvidence for Mrnf {
    const STATISTICS: Statistics = Statistics::None;

    fn check(&self) -> Result<(), Error> {
        Error::within("error", self.error, 0.0.., "0 or more")?;
        Error::within("power", self.power, 0.0..=1.0, "0 to 1")?;
        check_percent(self.percent)
    }

    fn request(&self) -> EvidenceRequest {
        EvidenceRequest { views: self.views, blended: true, ..EvidenceRequest::default() }
    }

    /// Pruned Gaussians are replaced in every round.
    fn reads_evidence(&self, _: u32, _: f32) -> bool {
        true
    }

    fn plan_with<S: DensityScene>(
        &self,
        observation: &Observation<'_, S>,
        evidence: &Evidence,
        rng: &mut Rng,
    ) -> Result<EditPlan<S::Gaussian>, Error> {
        let scene = observation.scene;
        let pruned = self.actions.prune.removals(observation);
        let pruned_count = pruned.len();
        let round = Round::with_removed(&self.actions, observation, pruned)?;
        let Scores { error, score } = self.scores(evidence, scene.len());
        let opacity = |index: u32| f64::from(sigmoid(scene.opacity_logit(index as usize)));
        let shown = |index: &u32| score[*index as usize] > 0.0;
        let parents = round.survivors().filter(shown).map(|index| (index, opacity(index)));
        let replaced = sample(parents, pruned_count.min(round.room()), rng);
        let is_candidate = |index: &u32| error[*index as usize] >= self.error;
        let candidates: Vec<u32> = round.survivors().filter(is_candidate).collect();
        let count = self.pace(observation, candidates.len(), round.room()).saturating_sub(replaced.len());
        let others = candidates.into_iter().filter(|index| replaced.binary_search(index).is_err());
        let grown = sample(others.map(|index| (index, score[index as usize])), count, rng);
        let densify = self.actions.densify;
        let two_of = |index: u32| densify.grow(index, observation, rng);
        Ok(round.grow_by([replaced, grown].concat(), two_of))
    }
}
