//! FastGS: growth and pruning by the pixels of high error in several views.

use gs_core::{
    EditPlan, Error,
    edit::{PruneCause, Removal},
    effects::Statistics,
    sigmoid,
};
use serde::{Deserialize, Serialize};

use super::{partial, rule::ByEvidence};
use crate::{
    observation::{DensityScene, Evidence, EvidenceRequest, Observation, Rng},
    round::{Actions, Densify, Prune, Round, SizeThreshold, WhenFlat, sample},
};

gs_core::impl_with!(FastGs);

/// Growth of Gaussians with a large gradient that cover pixels of high error in several views, and
/// pruning by such pixels (*source:* FastGS, Ren et al. 2025). For training in 3D.
///
/// A pixel has a high error where |C − Y|, scaled to 0..=1 within its view, exceeds
/// [`Self::high_error`]. A Gaussian's *density score* is the number of such pixels that it covers,
/// averaged over the views. Its *pruning score* is the same sum weighted by the views' losses and
/// scaled to 0..=1 over all Gaussians.
///
/// - While the number of Gaussians grows, those whose absolute gradient and density score reach
///   their thresholds are cloned or split. Of the Gaussians that [`Prune`] would remove, only a
///   share is removed, drawn with weight 1/(1 − pruning score). All opacities are then lowered to a
///   ceiling.
/// - Afterwards, every [`Self::final_every`] steps, Gaussians with a low opacity or a high pruning
///   score are removed.
///
/// There are two differences from the published code. It chooses clones, of which there are few, by
/// a second statistic, the mean gradient. It counts only pixels where Gaussians in front leave some
/// transmittance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
#[non_exhaustive]
pub struct FastGs {
    /// Number of training views for the scores, drawn again in each round; 0 for all. Default 10.
    pub views: u32,
    /// Least absolute gradient of a Gaussian that grows, normalised device units; not negative.
    /// Default 0.0012.
    pub threshold: f32,
    /// Error above which a pixel is one of high error, as a share of its view's range of errors,
    /// 0..=1. Default 0.1.
    pub high_error: f32,
    /// Least density score of a Gaussian that grows, px; not negative. Default 6 (published: above
    /// 5, after rounding down).
    pub pixels: f32,
    /// Share of the Gaussians to be pruned that are removed while the number grows, 0..=1. Default
    /// 0.5.
    pub prune_share: f32,
    /// Largest opacity after each round of growth, above 0 and at most 1. Default 0.8.
    pub opacity_ceiling: f32,
    /// Steps between two prunes after growth; at least 1. Default 3000.
    pub final_every: u32,
    /// Opacity below which a Gaussian is removed after growth, 0..=1. Default 0.1.
    pub final_opacity: f32,
    /// Pruning score above which a Gaussian is removed after growth, 0..=1. Default 0.9.
    pub final_score: f32,
    /// How Gaussians are cloned, split, pruned and reset. Default as in
    /// [`Grow::abs_gs`](crate::Grow::abs_gs), with growth in the first 15/27 of the rounds (until
    /// step 15,000, with rounds until 27,000).
    #[serde(deserialize_with = "partial::read::<FastGs, _>", serialize_with = "partial::write::<FastGs, _>")]
    pub actions: Actions,
}

impl Default for FastGs {
    fn default() -> Self {
        let densify = Densify { split_above: SizeThreshold::ExtentFraction(1e-3), ..Densify::default() };
        Self {
            views: 10,
            threshold: 0.0012,
            high_error: 0.1,
            pixels: 6.0,
            prune_share: 0.5,
            opacity_ceiling: 0.8,
            final_every: 3_000,
            final_opacity: 0.1,
            final_score: 0.9,
            actions: Actions { densify, growth_fraction: 15.0 / 27.0, ..Actions::default() },
        }
    }
}

/// The scores of all Gaussians, `[N]`.
struct Scores {
    density: Vec<f64>,
    pruning: Vec<f64>,
}

impl Scores {
    fn of(evidence: &Evidence, len: usize) -> Self {
        let views = evidence.views.len() as f64;
        let mut density = evidence.sum(len, |_| 1.0, |view| &view.covered.high_error);
        density.iter_mut().for_each(|sum| *sum /= views);
        let mut pruning = evidence.sum(len, |view| view.loss, |view| &view.covered.high_error);
        let (least, most) =
            pruning.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), &v| (least.min(v), most.max(v)));
        let range = if most > least { most - least } else { 1.0 };
        pruning.iter_mut().for_each(|score| *score = (*score - least) / range);
        Self { density, pruning }
    }
}

impl FastGs {
    /// Whether the round after `step` (from 0) prunes, if it does not grow.
    fn prunes_after(&self, step: u32) -> bool {
        (u64::from(step) + 1).is_multiple_of(u64::from(self.final_every))
    }

    /// The Gaussians removed while their number grows: a share of those that [`Prune`] would
    /// remove.
    fn removed_while_growing<S: DensityScene>(
        &self,
        observation: &Observation<'_, S>,
        pruning: &[f64],
        rng: &mut Rng,
    ) -> Vec<Removal> {
        let mut removals = self.actions.prune.removals(observation);
        let is_broken = |r: &Removal| r.cause == PruneCause::NotFinite;
        let weighted: Vec<(u32, f64)> = (removals.iter().filter(|r| !is_broken(r)))
            .map(|r| (r.index, 1.0 / (1e-6 + 1.0 - pruning[r.index as usize])))
            .collect();
        let count = (f64::from(self.prune_share) * weighted.len() as f64) as usize;
        let drawn = sample(weighted, count, rng);
        removals.retain(|r| is_broken(r) || drawn.binary_search(&r.index).is_ok());
        removals
    }

    /// The Gaussians removed after growth.
    fn removed_after_growth<S: DensityScene>(&self, observation: &Observation<'_, S>, pruning: &[f64]) -> Vec<Removal> {
        let broken = Prune { opacity: 0.0, larger_than: None, ..self.actions.prune }.removals(observation);
        let mut broken = broken.into_iter().peekable();
        let removal = |index: u32| {
            if let Some(removal) = broken.next_if(|r| r.index == index) {
                return Some(removal);
            }
            let cause = if sigmoid(observation.scene.opacity_logit(index as usize)) < self.final_opacity {
                PruneCause::Transparent
            } else if pruning[index as usize] > f64::from(self.final_score) {
                PruneCause::Unimportant
            } else {
                return None;
            };
            Some(Removal { index, cause })
        };
        (0..pruning.len() as u32).filter_map(removal).collect()
    }
}

impl ByEvidence for FastGs {
    const STATISTICS: Statistics = Statistics::AbsoluteGradient;

    fn check(&self) -> Result<(), Error> {
        for (what, value) in [("threshold", self.threshold), ("pixels", self.pixels)] {
            Error::within(what, value, 0.0.., "0 or more")?;
        }
        for (what, share) in [
            ("high-error", self.high_error),
            ("prune-share", self.prune_share),
            ("final-opacity", self.final_opacity),
            ("final-score", self.final_score),
        ] {
            Error::within(what, share, 0.0..=1.0, "0 to 1")?;
        }
        Error::within("opacity-ceiling", self.opacity_ceiling, f32::MIN_POSITIVE..=1.0, "above 0 and at most 1")?;
        Error::within("final-every", self.final_every, 1.., "at least 1")
    }

    fn aims_at_budget(&self) -> bool {
        false
    }

    fn request(&self) -> EvidenceRequest {
        EvidenceRequest { views: self.views, high_error: self.high_error, covered: true, ..EvidenceRequest::default() }
    }

    fn reads_evidence(&self, step: u32, progress: f32) -> bool {
        self.actions.grows(progress) || self.prunes_after(step)
    }

    fn plan_with<S: DensityScene>(
        &self,
        observation: &Observation<'_, S>,
        evidence: &Evidence,
        rng: &mut Rng,
    ) -> Result<EditPlan<S::Gaussian>, Error> {
        let Scores { density, pruning } = Scores::of(evidence, observation.scene.len());
        if !self.actions.grows(observation.progress) {
            let removed = self.removed_after_growth(observation, &pruning);
            return Ok(Round::with_removed(&self.actions, observation, removed)?.grow(&[], rng));
        }
        let removed = self.removed_while_growing(observation, &pruning, rng);
        let round = Round::with_removed(&self.actions, observation, removed)?;
        let ranking = round.rank_by_statistic(WhenFlat::Nothing);
        let agreed = |index: &u32| density[*index as usize] >= f64::from(self.pixels);
        let candidates: Vec<u32> = ranking.at_least(self.threshold).iter().copied().filter(agreed).collect();
        let mut plan = round.grow(&candidates, rng);
        if observation.scene.has_opacity() && self.opacity_ceiling < 1.0 {
            plan.opacity_ceiling =
                Some(plan.opacity_ceiling.map_or(self.opacity_ceiling, |c| c.min(self.opacity_ceiling)));
        }
        Ok(plan)
    }

    /// After growth, Gaussians are only pruned at an interval.
    fn removed<S: DensityScene>(&self, _: &Observation<'_, S>) -> Vec<Removal> {
        Vec::new()
    }
}
