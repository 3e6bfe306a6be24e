//! Pruning by contribution to the training views, for any growing policy.

use gs_core::{
    Error,
    edit::{PruneCause, Removal},
};
use serde::{Deserialize, Serialize};

use crate::{
    evidence::EvidenceRequest,
    gaussian::DensityScene,
    grow::{check_percent, share_of},
    observation::Observation,
};

gs_core::impl_with!(Simplify);

/// Settings of pruning by contribution, which removes the Gaussians that contribute least to the
/// training views. It works with any growing policy. For training in 3D.
///
/// A Gaussian's contribution is the sum of its blending weights over the pixels of the views
/// (*source:* Mini-Splatting, Fang and Wang 2024).
///
/// | constructor | when | what is removed |
/// |---|---|---|
/// | [`Simplify::speedy_splat`] | every 3,000 steps from 6,000 | 80 % while the number grows, then 30 % |
/// | [`Simplify::mini_splatting`] | after step 20,000 | those that hold 1 % of all contribution together |
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
#[non_exhaustive]
pub struct Simplify {
    /// Number of training views, drawn again each time; 0, the default, for all.
    pub views: u32,
    /// Steps between two simplifications, at least 1. Only rounds prune, so this should be a
    /// multiple of the steps between two rounds. Default 3000.
    pub every: u32,
    /// First step that may simplify, counted from 1. Default 6000.
    pub from: u32,
    /// Share of the Gaussians removed while their number grows, 0..=100 %. Default 80.
    pub soft_percent: f32,
    /// Share removed after [`Actions::growth_fraction`](crate::Actions::growth_fraction), 0..=100
    /// %. Default 30.
    pub hard_percent: f32,
    /// Share of the total contribution that the removed Gaussians may hold together, 0..=1. The
    /// larger of this and the percentage decides how many are removed. Default 0.
    pub mass: f32,
}

impl Default for Simplify {
    fn default() -> Self {
        Self::speedy_splat()
    }
}

impl Simplify {
    /// The schedule and percentages of Speedy-Splat (Hanson et al. 2025). Its published score, the
    /// squared change of the pixels with a Gaussian's α, is replaced by the contribution, because
    /// that score is not a weighted sum over an image.
    pub fn speedy_splat() -> Self {
        Self { views: 0, every: 3_000, from: 6_000, soft_percent: 80.0, hard_percent: 30.0, mass: 0.0 }
    }

    /// The last simplification of Mini-Splatting (Fang and Wang 2024), which keeps 99 % of the
    /// contribution. Its first one, a random half weighted by contribution, is left out.
    pub fn mini_splatting() -> Self {
        Self { every: 20_000, from: 20_000, soft_percent: 0.0, hard_percent: 0.0, mass: 0.01, ..Self::speedy_splat() }
    }

    /// The evidence that the round after `step` (from 0) needs.
    pub(crate) fn evidence(&self, step: u32) -> Option<EvidenceRequest> {
        self.is_due(step.saturating_add(1)).then(|| EvidenceRequest::of_contribution(self.views))
    }

    /// Whether a round after step `steps`, counted from 1, simplifies.
    pub fn is_due(&self, steps: u32) -> bool {
        steps >= self.from && steps.is_multiple_of(self.every.max(1))
    }

    /// Adds to `removed`, which is ordered by index, the Gaussians that contribute least.
    ///
    /// # Errors
    /// Those of [`Observation::requested`].
    pub(crate) fn remove<S: DensityScene>(
        &self,
        observation: &Observation<'_, S>,
        grows: bool,
        removed: &mut Vec<Removal>,
    ) -> Result<(), Error> {
        let Some(request) = self.evidence(observation.step) else { return Ok(()) };
        let contribution = &observation.requested("simplify", &request)?.contribution;
        let mut gone = removed.iter().map(|r| r.index).peekable();
        let mut left: Vec<u32> =
            (0..contribution.len() as u32).filter(|&index| gone.next_if_eq(&index).is_none()).collect();
        let of = |index: u32| contribution[index as usize];
        left.sort_by(|&a, &b| of(a).total_cmp(&of(b)));
        let percent = if grows { self.soft_percent } else { self.hard_percent };
        let allowed = f64::from(self.mass) * left.iter().map(|&index| of(index)).sum::<f64>();
        let mut held = 0.0;
        let by_mass = left
            .iter()
            .take_while(|&&index| {
                held += of(index);
                held <= allowed && self.mass > 0.0
            })
            .count();
        left.truncate(share_of(left.len(), percent).max(by_mass));
        removed.extend(left.into_iter().map(|index| Removal { index, cause: PruneCause::Unimportant }));
        removed.sort_unstable_by_key(|r| r.index);
        Ok(())
    }

    /// Checks the ranges of all settings.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first value outside its range.
    pub fn validate(&self) -> Result<(), Error> {
        if self.every == 0 {
            return Err(Error::setting("simplify.every", 0, "at least 1"));
        }
        check_percent(self.soft_percent)?;
        check_percent(self.hard_percent)?;
        if (0.0..=1.0).contains(&self.mass) {
            Ok(())
        } else {
            Err(Error::setting("simplify.mass", self.mass, "0 to 1"))
        }
    }
}
