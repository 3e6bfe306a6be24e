//! Rank × floor × budget: growth by rank, but not of Gaussians that have nothing to gain.

use gs_core::{EditPlan, Error, PlanarGaussian, constants::TAU_POSITION, effects::Statistics};
use serde::{Deserialize, Serialize};

use crate::{
    absolute::check_threshold,
    observation::{DensityPolicy, Observation, Rng},
    percentile::{FORCED_GROWTH_PERCENT, check_percent},
    ranking::WhenFlat,
    round::{Actions, Round},
};

/// The product of [`RelativePercentile`](crate::RelativePercentile) and [`AbsoluteThreshold`](crate::AbsoluteThreshold): of the
/// first few by rank, those grow whose mean positional gradient is also at least a floor, until the budget is reached.
///
/// The rank sets the pace, whatever the contrast of the image; the floor, far below 3DGS's threshold, only ends growth where there
/// is nothing to gain; and the budget is a target: the round that reaches it ends at exactly that many.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub struct Hybrid {
    /// Share of the Gaussians left after pruning that may grow in each round, rounded up. 0..=100 %, default
    /// [`FORCED_GROWTH_PERCENT`].
    pub percent: f32,
    /// The least gradient that grows, normalised device units; not negative. Default a hundredth of [`TAU_POSITION`]. At 0, any
    /// gradient but 0 does.
    pub floor: f32,
    /// What is done to the Gaussians.
    pub actions: Actions,
}

impl Default for Hybrid {
    fn default() -> Self {
        Self { percent: FORCED_GROWTH_PERCENT, floor: 0.01 * TAU_POSITION, actions: Actions::default() }
    }
}

impl Hybrid {
    /// Fails where a number is outside its range.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first offender.
    pub fn validate(&self) -> Result<(), Error> {
        check_percent(self.percent)?;
        check_threshold("floor", self.floor)?;
        self.actions.validate()
    }
}

impl DensityPolicy for Hybrid {
    fn plan(&self, observation: &Observation<'_>, rng: &mut Rng) -> Result<EditPlan<PlanarGaussian>, Error> {
        self.validate()?;
        let round = Round::open(&self.actions, observation)?;
        let ranking = round.rank_by_gradient(WhenFlat::Nothing);
        // Both are the head of one ranking, so the shorter is what they have in common.
        let (by_rank, by_floor) = (ranking.top_percent(self.percent), ranking.at_least(self.floor));
        Ok(round.grow(if by_rank.len() < by_floor.len() { by_rank } else { by_floor }, rng))
    }

    fn statistics(&self) -> Statistics {
        Statistics::MeanGradient
    }

    fn needs_residual(&self) -> bool {
        false
    }
}
