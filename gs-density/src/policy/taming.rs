//! Taming 3DGS: growth by a weighted score of nine parts, along a schedule of counts.

use gs_core::{EditPlan, Error, constants::TAU_POSITION, effects::Statistics, sigmoid};
use serde::{Deserialize, Serialize};

use super::{partial, rule::ByEvidence};
use crate::{
    observation::{DensityGaussian, DensityScene, Evidence, EvidenceRequest, Observation, Rng, ViewEvidence},
    round::{Actions, Round, WhenFlat, add_normalised, sample, scheduled_count},
};

gs_core::impl_with!(Taming, ScoreWeights);

/// Growth by a weighted score, along a schedule of counts that ends at the budget (*source:* Taming
/// 3DGS, Mallick et al. 2024). For training in 3D.
///
/// With p the progress of the rounds, N₀ the first number of Gaussians and B the budget, the number
/// after a round is N₀ + (B − N₀)(2p − p²), if enough Gaussians reach the threshold of 3DGS.
/// Gaussians that grow are drawn in proportion to their score. Clones and splits are drawn
/// separately, each by their share.
///
/// The score is a sum over the views: the view's loss times the weighted sum of
/// [`ScoreWeights`]' parts, for the Gaussians that the view shows.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
#[non_exhaustive]
pub struct Taming {
    /// Number of training views for the score, drawn again in each round; 0 for all. Default 10.
    pub views: u32,
    /// Least mean gradient of a Gaussian that grows, normalised device units; not negative. Default
    /// [`TAU_POSITION`].
    pub threshold: f32,
    /// Weights of the score's parts.
    pub weights: ScoreWeights,
    /// How Gaussians are cloned, split, pruned and reset. The published code removes only a random
    /// half of the Gaussians that [`Prune`](crate::Prune) removes.
    #[serde(deserialize_with = "partial::read::<Taming, _>", serialize_with = "partial::write::<Taming, _>")]
    pub actions: Actions,
}

/// Weights of the parts of the score of [`Taming`]; none is negative. Each part is divided by its
/// median over the Gaussians where it is positive. The defaults come from the published code.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
#[non_exhaustive]
pub struct ScoreWeights {
    /// Mean gradient. Default 25.
    pub gradient: f32,
    /// Opacity. Default 100.
    pub opacity: f32,
    /// Depth in the view. Default 5.
    pub depth: f32,
    /// Radius in the view. Default 10.
    pub radius: f32,
    /// Product of the scales. Default 25.
    pub volume: f32,
    /// Errors and edges, in equal parts, over the pixels that the Gaussian covers. Default 10.
    pub error: f32,
    /// Number of pixels that the Gaussian covers. Default 0.1.
    pub pixels: f32,
    /// Sum of the blending weights. Default 50.
    pub blending: f32,
    /// Sum of the distances of the covered pixels from the mean, approximated by that of a disc
    /// with the same number of pixels. Default 50.
    pub distance: f32,
}

impl Default for ScoreWeights {
    fn default() -> Self {
        Self {
            gradient: 25.0,
            opacity: 100.0,
            depth: 5.0,
            radius: 10.0,
            volume: 25.0,
            error: 10.0,
            pixels: 0.1,
            blending: 50.0,
            distance: 50.0,
        }
    }
}

impl Default for Taming {
    fn default() -> Self {
        Self { views: 10, threshold: TAU_POSITION, weights: ScoreWeights::default(), actions: Actions::default() }
    }
}

impl Taming {
    /// The score of every Gaussian, `[N]`.
    fn scores<S: DensityScene>(&self, observation: &Observation<'_, S>, evidence: &Evidence) -> Vec<f64> {
        let (scene, weights) = (observation.scene, &self.weights);
        let mut own = vec![0.0; scene.len()];
        add_normalised(&mut own, weights.gradient, |i| observation.statistics.mean_signal(i));
        add_normalised(&mut own, weights.opacity, |i| sigmoid(scene.opacity_logit(i)));
        let volumes: Vec<f32> = (0..scene.len()).map(|i| scene.gaussian(i).volume()).collect();
        add_normalised(&mut own, weights.volume, |i| volumes[i]);
        let mut scores = vec![0.0; scene.len()];
        for ViewEvidence { loss, blended, covered, depth, radius_px } in &evidence.views {
            let mut of_view = own.clone();
            add_normalised(&mut of_view, weights.depth, |i| depth[i]);
            add_normalised(&mut of_view, weights.radius, |i| radius_px[i]);
            add_normalised(&mut of_view, weights.error, |i| covered.error[i]);
            add_normalised(&mut of_view, weights.pixels, |i| covered.pixels[i]);
            add_normalised(&mut of_view, weights.blending, |i| blended.pixels[i]);
            add_normalised(&mut of_view, weights.distance, |i| covered.pixels[i].powf(1.5));
            for (i, (score, of_view)) in scores.iter_mut().zip(of_view).enumerate() {
                if covered.pixels[i] > 0.0 {
                    *score += f64::from(*loss) * of_view;
                }
            }
        }
        scores
    }
}

impl ByEvidence for Taming {
    const STATISTICS: Statistics = Statistics::MeanGradient;

    fn check(&self) -> Result<(), Error> {
        let ScoreWeights { gradient, opacity, depth, radius, volume, error, pixels, blending, distance } = self.weights;
        for (what, value) in [
            ("threshold", self.threshold),
            ("weights.gradient", gradient),
            ("weights.opacity", opacity),
            ("weights.depth", depth),
            ("weights.radius", radius),
            ("weights.volume", volume),
            ("weights.error", error),
            ("weights.pixels", pixels),
            ("weights.blending", blending),
            ("weights.distance", distance),
        ] {
            Error::within(what, value, 0.0..=f32::MAX, "0 or more, and finite")?;
        }
        Ok(())
    }

    fn request(&self) -> EvidenceRequest {
        EvidenceRequest {
            views: self.views,
            l1: 1.0,
            edges: 1.0,
            blended: true,
            covered: true,
            geometry: true,
            ..EvidenceRequest::default()
        }
    }

    fn plan_with<S: DensityScene>(
        &self,
        observation: &Observation<'_, S>,
        evidence: &Evidence,
        rng: &mut Rng,
    ) -> Result<EditPlan<S::Gaussian>, Error> {
        let round = Round::open(&self.actions, observation)?;
        let scores = self.scores(observation, evidence);
        let ranking = round.rank_by_statistic(WhenFlat::Nothing);
        let is_split = |i: u32| {
            self.actions.densify.split_above.is_exceeded(&observation.scene.gaussian(i as usize), observation.extent)
        };
        let (splits, clones): (Vec<u32>, Vec<u32>) =
            ranking.at_least(self.threshold).iter().partition(|&&index| is_split(index));
        let Observation { progress_before, progress, budget, .. } = *observation;
        let wanted = scheduled_count(observation.scene.len(), budget, progress_before, progress);
        let quota = wanted.saturating_sub(round.survivors().count()).min(splits.len() + clones.len());
        let of_splits = (quota * splits.len()).checked_div(splits.len() + clones.len()).unwrap_or(0);
        let mut chosen = Vec::new();
        for (candidates, count) in [(splits, of_splits), (clones, quota - of_splits)] {
            chosen.extend(sample(candidates.into_iter().map(|i| (i, scores[i as usize])), count, rng));
        }
        Ok(round.grow(&chosen, rng))
    }
}
