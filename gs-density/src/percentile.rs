//! Growth of the first few by rank, whatever their gradients: the paper's forced growth.

use gs_core::{EditPlan, Error, effects::Statistics};
use serde::{Deserialize, Serialize};

use crate::{
    gaussian::DensityScene,
    observation::{DensityPolicy, Observation, Rng},
    ranking::WhenFlat,
    round::{Actions, Round},
    signal::Signal,
};

/// The share of the Gaussians that forced growth lets grow in each round, %. *Source:* paper §3.4.3.
pub const FORCED_GROWTH_PERCENT: f32 = 10.0;

/// The Gaussians with the largest signals (mean positional gradients) grow, a fixed share of them, regardless of a threshold (*source:*
/// paper §3.4.3 and §5.2).
///
/// The count rises by that share a round: from 20 by 10 % in 24 rounds to 234, rounding up included.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub struct RelativePercentile {
    /// What calls for growth. Default the mean gradient.
    pub signal: Signal,
    /// Share of the Gaussians left after pruning that grows in each round, rounded up, so at least one does. 0..=100 %, default
    /// [`FORCED_GROWTH_PERCENT`]; 0 lets none grow.
    pub percent: f32,
    /// What is done where gradients are 0. Default nothing.
    pub when_flat: WhenFlat,
    /// What is done to the Gaussians.
    pub actions: Actions,
}

impl Default for RelativePercentile {
    fn default() -> Self {
        Self::by(Signal::default())
    }
}

impl RelativePercentile {
    /// The defaults by this signal.
    pub fn by(signal: Signal) -> Self {
        Self { signal, percent: FORCED_GROWTH_PERCENT, when_flat: WhenFlat::Nothing, actions: Actions::default() }
    }

    /// Fails where a number is outside its range.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first offender.
    pub fn validate(&self) -> Result<(), Error> {
        check_percent(self.percent)?;
        self.actions.validate()
    }
}

impl<S: DensityScene> DensityPolicy<S> for RelativePercentile {
    fn plan(&self, observation: &Observation<'_, S>, rng: &mut Rng) -> Result<EditPlan<S::Gaussian>, Error> {
        self.validate()?;
        let round = Round::open(&self.actions, observation)?;
        let ranking = round.rank_by_statistic(self.when_flat);
        Ok(round.grow(ranking.top_percent(self.percent), rng))
    }

    fn statistics(&self) -> Statistics {
        self.signal.statistics()
    }

    fn needs_residual(&self) -> bool {
        false
    }
}

/// How many grow in a round of which `percent` % of so many may: rounded up, so at least one, unless `percent` is 0.
pub fn share_of(count: usize, percent: f32) -> usize {
    let exact = count as f64 * f64::from(percent) / 100.0;
    // A percentage that f32 holds a little too large, such as 0.1, must not round a whole number up to the next.
    (exact * (1.0 - f64::from(f32::EPSILON))).ceil() as usize
}

/// Fails unless `value` is a percentage.
pub(crate) fn check_percent(value: f32) -> Result<(), Error> {
    if (0.0..=100.0).contains(&value) { Ok(()) } else { Err(Error::setting("percent", value, "0 to 100")) }
}
