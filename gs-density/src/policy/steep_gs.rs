//! SteepGS: splits of Gaussians that are stuck at saddle points, along the steepest descent.

use glam::{DMat3, DVec3, Vec3};
use gs_core::{
    EditPlan, Error,
    constants::TAU_POSITION,
    edit::{Birth, Change, Origin},
    effects::Statistics,
};
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use super::{partial, rule::ByEvidence};
use crate::{
    eigen,
    observation::{DensityGaussian, DensityScene, Evidence, EvidenceRequest, Observation, Rng},
    round::{Actions, Densify, OpacityCorrection, Round, WhenFlat},
};

gs_core::impl_with!(SteepGs);

/// Splits of Gaussians whose splitting matrix has a negative eigenvalue (*source:* Steepest Descent
/// Density Control, Wang et al. 2025, arXiv 2505.05587). For training in 3D.
///
/// Replacing a Gaussian by two of half its opacity, at μ ± δ, changes the loss by ½ δᵀ S δ, where S
/// is its splitting matrix ([`Evidence::splitting`](crate::Evidence::splitting)). Where S has no
/// negative eigenvalue, a split gains nothing. Otherwise the eigenvector of the smallest one is the
/// direction of steepest descent.
///
/// - Candidates are Gaussians whose mean gradient reaches a threshold, as in 3DGS. Those grow whose
///   S has an eigenvalue below −[`Self::eigenvalue`].
/// - The two halves stand on either side along the eigenvector, with half of the opacity. Of a
///   Gaussian above [`Densify::split_above`], each stands at the length of a vector drawn from the
///   Gaussian, and is as much smaller as a split of 3DGS. Halves of a smaller one keep its size and
///   move by [`Self::step`].
///
/// Differences from the published code: it sums S over all steps between two rounds, here it is a
/// mean over several views of the round; and its default estimate of S is the derivative by the
/// opacity times Σ⁻¹, here S has also the term with the gradient by Σ, as in the paper.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
#[non_exhaustive]
pub struct SteepGs {
    /// Number of training views for S, drawn again in each round; 0 for all. Default 10 (this
    /// project's choice).
    pub views: u32,
    /// Least mean gradient of a Gaussian that grows, normalised device units; not negative. Default
    /// [`TAU_POSITION`].
    pub threshold: f32,
    /// Least size of the negative eigenvalue, loss per square world unit; not negative. Default
    /// 1e-6.
    pub eigenvalue: f32,
    /// Distance of either half of a small Gaussian from its mean, in extents of the scene; not
    /// negative. Default 0.00016: the code moves them by one learning rate of positions, which is
    /// that at first.
    pub step: f32,
    /// How Gaussians are split, pruned and reset. Default: half of the opacity for both.
    #[serde(deserialize_with = "partial::read::<SteepGs, _>", serialize_with = "partial::write::<SteepGs, _>")]
    pub actions: Actions,
}

impl Default for SteepGs {
    fn default() -> Self {
        let densify = Densify { opacity_correction: OpacityCorrection::Halve, ..Densify::default() };
        let actions = Actions { densify, ..Actions::default() };
        Self { views: 10, threshold: TAU_POSITION, eigenvalue: 1e-6, step: 1.6e-4, actions }
    }
}

/// The smallest eigenvalue of the splitting matrix in world axes, and its eigenvector of length 1;
/// `None` where the Gaussian has no volume.
fn steepest(gaussian: &impl DensityGaussian, splitting: [f32; 6]) -> Option<(f64, DVec3)> {
    let inverse = gaussian.axes()?.as_dmat3().inverse();
    let [xx, xy, xz, yy, yz, zz] = splitting.map(f64::from);
    let own = DMat3::from_cols(DVec3::new(xx, xy, xz), DVec3::new(xy, yy, yz), DVec3::new(xz, yz, zz));
    let world = inverse.transpose() * own * inverse;
    world.is_finite().then(|| eigen::smallest(world))
}

impl SteepGs {
    /// The two halves of Gaussian `index`, and how they came about.
    fn halves<S: DensityScene>(
        &self,
        index: u32,
        direction: Vec3,
        observation: &Observation<'_, S>,
        rng: &mut Rng,
    ) -> (Option<Change<S::Gaussian>>, Birth<S::Gaussian>) {
        let densify = &self.actions.densify;
        let parent = observation.scene.gaussian(index as usize);
        let is_split = densify.split_above.is_exceeded(&parent, observation.extent);
        let axes = parent.axes().unwrap_or_default();
        let pair = [1.0, -1.0].map(|side| {
            if !is_split {
                return parent.moved_by(side * self.step * observation.extent * direction);
            }
            let drawn = Vec3::new(StandardNormal.sample(rng), StandardNormal.sample(rng), StandardNormal.sample(rng));
            let mut half = parent.moved_by(side * (axes * drawn).length() * direction);
            half.resize(-densify.shrink.ln());
            half
        });
        densify.replaced(index, observation, pair, if is_split { Origin::Split } else { Origin::Clone })
    }
}

impl ByEvidence for SteepGs {
    const STATISTICS: Statistics = Statistics::MeanGradient;

    fn check(&self) -> Result<(), Error> {
        for (what, value) in [("threshold", self.threshold), ("eigenvalue", self.eigenvalue), ("step", self.step)] {
            Error::within(what, value, 0.0..=f32::MAX, "0 or more, and finite")?;
        }
        Ok(())
    }

    fn aims_at_budget(&self) -> bool {
        false
    }

    fn request(&self) -> EvidenceRequest {
        EvidenceRequest { views: self.views, splitting: true, ..EvidenceRequest::default() }
    }

    fn plan_with<S: DensityScene>(
        &self,
        observation: &Observation<'_, S>,
        evidence: &Evidence,
        rng: &mut Rng,
    ) -> Result<EditPlan<S::Gaussian>, Error> {
        let round = Round::open(&self.actions, observation)?;
        let splitting = &evidence.splitting;
        let ranking = round.rank_by_statistic(WhenFlat::Nothing);
        let mut directions: Vec<(u32, Vec3)> = (ranking.at_least(self.threshold).iter())
            .filter_map(|&index| {
                let gaussian = observation.scene.gaussian(index as usize);
                let (least, direction) = steepest(&gaussian, splitting[index as usize])?;
                (least < -f64::from(self.eigenvalue)).then(|| (index, direction.as_vec3()))
            })
            .take(round.room())
            .collect();
        directions.sort_unstable_by_key(|&(index, _)| index);
        let chosen = directions.iter().map(|&(index, _)| index).collect();
        let mut directions = directions.into_iter().map(|(_, direction)| direction);
        Ok(round.grow_by(chosen, |index| {
            let direction = directions.next().unwrap_or_default();
            self.halves(index, direction, observation, rng)
        }))
    }
}
