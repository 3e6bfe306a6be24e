//! The policy of the paper's own experiment: forced growth on top of the absolute threshold.

use gs_core::{EditPlan, Error, constants::TAU_POSITION, effects::Statistics};
use serde::{Deserialize, Serialize};

use crate::{
    absolute::check_threshold,
    gaussian::DensityScene,
    observation::{DensityPolicy, Observation, Rng},
    percentile::{FORCED_GROWTH_PERCENT, check_percent},
    ranking::WhenFlat,
    round::{Actions, Round},
};

/// The union of [`RelativePercentile`](crate::RelativePercentile) and [`AbsoluteThreshold`](crate::AbsoluteThreshold).
///
/// The paper (§3.4.3) forces the first 10 % to grow "regardless of an absolute threshold" and goes from 20 Gaussians to 600. Were
/// that all, 24 rounds would end at 234; so the threshold must have been at work, too. While gradients are above it the count doubles
/// each round, and forced growth carries on where they no longer are.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub struct Paper {
    /// Share of the Gaussians left after pruning that grows in each round in any case, rounded up. 0..=100 %, default
    /// [`FORCED_GROWTH_PERCENT`]; 0 leaves the threshold alone.
    pub percent: f32,
    /// The gradient at which a Gaussian grows in any case, normalised device units; not negative. Default [`TAU_POSITION`]; ∞
    /// leaves the share alone.
    pub threshold: f32,
    /// What forced growth does where gradients are 0. Default nothing.
    pub when_flat: WhenFlat,
    /// What is done to the Gaussians.
    pub actions: Actions,
}

impl Default for Paper {
    fn default() -> Self {
        Self {
            percent: FORCED_GROWTH_PERCENT,
            threshold: TAU_POSITION,
            when_flat: WhenFlat::Nothing,
            actions: Actions::default(),
        }
    }
}

impl Paper {
    /// Fails where a number is outside its range.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first offender.
    pub fn validate(&self) -> Result<(), Error> {
        check_percent(self.percent)?;
        check_threshold("threshold", self.threshold)?;
        self.actions.validate()
    }
}

impl<S: DensityScene> DensityPolicy<S> for Paper {
    fn plan(&self, observation: &Observation<'_, S>, rng: &mut Rng) -> Result<EditPlan<S::Gaussian>, Error> {
        self.validate()?;
        let round = Round::open(&self.actions, observation)?;
        let ranking = round.rank_by_statistic(self.when_flat);
        // Gaussians without a gradient are there for the share alone, even at a threshold of 0.
        let by_threshold = ranking.at_least(self.threshold.max(f32::MIN_POSITIVE));
        let by_rank = ranking.top_percent(self.percent);
        // Both are the head of one ranking, so the longer is their union.
        Ok(round.grow(if by_rank.len() > by_threshold.len() { by_rank } else { by_threshold }, rng))
    }

    fn statistics(&self) -> Statistics {
        Statistics::MeanGradient
    }

    fn needs_residual(&self) -> bool {
        false
    }
}
