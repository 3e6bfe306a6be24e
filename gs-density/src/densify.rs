//! What is done to a Gaussian that grows: cloned where it is small, split where it is large.
//!
//! One becomes two either way. The *original* keeps its slot in the scene, and so its place in the order of blending; the *copy*
//! is added right behind it. Ancestors differ in what they do to the two, mostly by accident; here each such point is a setting.

use glam::Vec2;
use gs_core::{
    Error, PlanarGaussian, Scene,
    constants::SPLIT_PHI,
    edit::{Birth, Change, Moments, Origin, Place},
};
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use crate::{
    correction::OpacityCorrection,
    observation::{Observation, Rng},
    size::SizeThreshold,
};

/// Where the copy stands that cloning adds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ClonePlacement {
    /// On the original, which stays (what the code of 3DGS does). The two part only by their different moments, under
    /// [`Blend::Over`](gs_core::Blend) also by their order.
    #[default]
    OnOriginal,
    /// At a point drawn from the original, which stays.
    Drawn,
}

/// Where the two halves stand that splitting makes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SplitPlacement {
    /// At two points drawn independently from the parent (paper §2.2.2, 3DGS).
    #[default]
    Drawn,
    /// On the parent's long axis, half of its larger scale to either side of its mean: no luck involved.
    LongAxis,
}

/// Which of the two keeps the Adam moments of the one; the others start afresh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MomentHeir {
    /// The one that stays in the parent's slot.
    #[default]
    Original,
    /// The one that is added.
    Copy,
    /// Both.
    Both,
    /// None of them.
    Neither,
}

impl MomentHeir {
    /// What becomes of the moments of the original and of the copy.
    fn moments(self) -> (Moments, Moments) {
        match self {
            Self::Original => (Moments::Inherit, Moments::Fresh),
            Self::Copy => (Moments::Fresh, Moments::Inherit),
            Self::Both => (Moments::Inherit, Moments::Inherit),
            Self::Neither => (Moments::Fresh, Moments::Fresh),
        }
    }
}

/// How one Gaussian becomes two. The defaults are those of 3DGS.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub struct Densify {
    /// Gaussians larger than this are split, the others cloned. Default 0.01 of the image's longer side (3DGS:
    /// `percent_dense` of the scene's extent).
    pub split_above: SizeThreshold,
    /// What splitting divides both scales by (φ), at least 1. Default [`SPLIT_PHI`].
    pub shrink: f32,
    /// Where the halves of a split stand. Default drawn.
    pub split_placement: SplitPlacement,
    /// Where a clone stands. Default on its original.
    pub clone_placement: ClonePlacement,
    /// What becomes of the opacity. Default none.
    pub opacity_correction: OpacityCorrection,
    /// Which of a split's halves keeps the moments. Default neither: both have moved.
    pub split_moments: MomentHeir,
    /// Which of original and clone keeps the moments. Default the original.
    pub clone_moments: MomentHeir,
    /// Where the copy stands in the order of blending. Default behind its parent, where a copy in space would be; what an engine
    /// does that appends to its arrays is last, behind the large Gaussians that were there before it.
    pub copy_place: Place,
}

impl Default for Densify {
    fn default() -> Self {
        Self {
            split_above: SizeThreshold::ExtentFraction(0.01),
            shrink: SPLIT_PHI,
            split_placement: SplitPlacement::Drawn,
            clone_placement: ClonePlacement::OnOriginal,
            opacity_correction: OpacityCorrection::None,
            split_moments: MomentHeir::Neither,
            clone_moments: MomentHeir::Original,
            copy_place: Place::BehindParent,
        }
    }
}

impl Densify {
    /// Makes two of Gaussian `index` of the observed scene: what becomes of the original (`None` where it stays untouched), and
    /// the copy.
    ///
    /// # Panics
    /// When the scene has no such Gaussian.
    pub fn grow(
        &self,
        index: u32,
        observation: &Observation<'_>,
        rng: &mut Rng,
    ) -> (Option<Change<PlanarGaussian>>, Birth<PlanarGaussian>) {
        let parent = observation.scene.gaussian(index as usize);
        let (mut pair, origin, heir) = if self.split_above.is_exceeded(&parent, observation.size) {
            (self.split(&parent, rng), Origin::Split, self.split_moments)
        } else {
            (self.clone_of(&parent, rng), Origin::Clone, self.clone_moments)
        };
        for half in &mut pair {
            self.opacity_correction.apply(half, observation.scene.has_opacity());
        }
        let [original, copy] = pair;
        let (original_moments, copy_moments) = heir.moments();
        let is_touched = original != parent || original_moments == Moments::Fresh;
        let change = is_touched.then_some(Change { index, gaussian: original, moments: original_moments });
        (change, Birth { gaussian: copy, parent: Some(index), moments: copy_moments, origin, place: self.copy_place })
    }

    /// Fails where a number is outside its range.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the offender.
    pub fn validate(&self) -> Result<(), Error> {
        if !(self.shrink >= 1.0 && self.shrink.is_finite()) {
            return Err(Error::setting("densify.shrink", self.shrink, "at least 1 and finite"));
        }
        self.split_above.validate("densify.split-above")
    }

    fn split(&self, parent: &PlanarGaussian, rng: &mut Rng) -> [PlanarGaussian; 2] {
        let frame = parent.frame();
        let offsets = match self.split_placement {
            SplitPlacement::Drawn => [frame * standard_normal(rng), frame * standard_normal(rng)],
            SplitPlacement::LongAxis => {
                let is_first_longer = parent.log_scale.x >= parent.log_scale.y;
                let half = 0.5 * if is_first_longer { frame.x_axis } else { frame.y_axis };
                [-half, half]
            }
        };
        let log_scale = parent.log_scale - self.shrink.ln();
        offsets.map(|offset| PlanarGaussian { mean: parent.mean + offset, log_scale, ..*parent })
    }

    fn clone_of(&self, parent: &PlanarGaussian, rng: &mut Rng) -> [PlanarGaussian; 2] {
        let offset = match self.clone_placement {
            ClonePlacement::OnOriginal => Vec2::ZERO,
            ClonePlacement::Drawn => parent.frame() * standard_normal(rng),
        };
        [*parent, PlanarGaussian { mean: parent.mean + offset, ..*parent }]
    }
}

fn standard_normal(rng: &mut Rng) -> Vec2 {
    Vec2::new(StandardNormal.sample(rng), StandardNormal.sample(rng))
}
