//! Growth above an absolute threshold on the gradient, as 3DGS has it.

use gs_core::{EditPlan, Error, PlanarGaussian, constants::TAU_POSITION, effects::Statistics};
use serde::{Deserialize, Serialize};

use crate::{
    observation::{DensityPolicy, Observation, Rng},
    ranking::WhenFlat,
    round::{Actions, Round},
};

/// Every Gaussian grows whose mean positional gradient is at least a threshold (*source:* 3DGS).
///
/// The paper (§5.2) shows its weakness: how large gradients are depends on the image's contrast and on the loss, and a blurry fit
/// may have none above the threshold; growth then ends too early. Gradients of 0 never grow, whatever the threshold.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub struct AbsoluteThreshold {
    /// τ, on [`mean_gradient`](gs_core::DensityStatistics::mean_gradient), normalised device units; not negative. Default
    /// [`TAU_POSITION`].
    pub threshold: f32,
    /// What is done to the Gaussians.
    pub actions: Actions,
}

impl Default for AbsoluteThreshold {
    fn default() -> Self {
        Self { threshold: TAU_POSITION, actions: Actions::default() }
    }
}

impl AbsoluteThreshold {
    /// Fails where a number is outside its range.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first offender.
    pub fn validate(&self) -> Result<(), Error> {
        check_threshold("threshold", self.threshold)?;
        self.actions.validate()
    }
}

impl DensityPolicy for AbsoluteThreshold {
    fn plan(&self, observation: &Observation<'_>, rng: &mut Rng) -> Result<EditPlan<PlanarGaussian>, Error> {
        self.validate()?;
        let round = Round::open(&self.actions, observation)?;
        let ranking = round.rank_by_gradient(WhenFlat::Nothing);
        Ok(round.grow(ranking.at_least(self.threshold), rng))
    }

    fn statistics(&self) -> Statistics {
        Statistics::MeanGradient
    }

    fn needs_residual(&self) -> bool {
        false
    }
}

/// Fails for NaN and below 0; +∞ is a threshold that nothing reaches.
pub(crate) fn check_threshold(what: &'static str, value: f32) -> Result<(), Error> {
    if value >= 0.0 { Ok(()) } else { Err(Error::setting(what, value, "0 or more")) }
}
