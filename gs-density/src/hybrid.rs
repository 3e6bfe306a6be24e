//! Rank × floor × budget: growth by rank, but not of Gaussians that have nothing to gain.

use gs_core::{EditPlan, Error, effects::Statistics};
use serde::{Deserialize, Serialize};

use crate::{
    absolute::check_threshold,
    gaussian::DensityScene,
    observation::{DensityPolicy, Observation, Rng},
    percentile::{FORCED_GROWTH_PERCENT, check_percent},
    ranking::WhenFlat,
    round::{Actions, Round},
    signal::Signal,
};

/// The floor's share of the signal's threshold.
const FLOOR_SHARE: f32 = 0.01;

/// The product of [`RelativePercentile`](crate::RelativePercentile) and [`AbsoluteThreshold`](crate::AbsoluteThreshold): of the
/// first few by rank, those grow whose signal is also at least a floor, until the budget is reached.
///
/// The rank sets the pace, whatever the contrast of the image; the floor, far below 3DGS's threshold, only ends growth where there
/// is nothing to gain; and the budget is a target: the round that reaches it ends at exactly that many.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", from = "Partial")]
pub struct Hybrid {
    /// What calls for growth. Default the mean gradient.
    pub signal: Signal,
    /// Share of the Gaussians left after pruning that may grow in each round, rounded up. 0..=100 %, default
    /// [`FORCED_GROWTH_PERCENT`].
    pub percent: f32,
    /// The least signal that grows, in its unit; not negative. Default a hundredth of [`Signal::threshold`]; in a settings file, of that of
    /// the signal named there. At 0, any signal but 0 does.
    pub floor: f32,
    /// What is done to the Gaussians.
    pub actions: Actions,
}

impl Default for Hybrid {
    fn default() -> Self {
        Self::by(Signal::default())
    }
}

/// A settings file's form: what is missing depends on what is there.
#[derive(Default, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
struct Partial {
    signal: Signal,
    percent: Option<f32>,
    floor: Option<f32>,
    actions: Actions,
}

impl From<Partial> for Hybrid {
    fn from(Partial { signal, percent, floor, actions }: Partial) -> Self {
        let usual = Self::by(signal);
        Self { signal, percent: percent.unwrap_or(usual.percent), floor: floor.unwrap_or(usual.floor), actions }
    }
}

impl Hybrid {
    /// The defaults by this signal.
    pub fn by(signal: Signal) -> Self {
        let floor = FLOOR_SHARE * signal.threshold();
        Self { signal, percent: FORCED_GROWTH_PERCENT, floor, actions: Actions::default() }
    }

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

impl<S: DensityScene> DensityPolicy<S> for Hybrid {
    fn plan(&self, observation: &Observation<'_, S>, rng: &mut Rng) -> Result<EditPlan<S::Gaussian>, Error> {
        self.validate()?;
        let round = Round::open(&self.actions, observation)?;
        let ranking = round.rank_by_statistic(WhenFlat::Nothing);
        // Both are the head of one ranking, so the shorter is what they have in common.
        let (by_rank, by_floor) = (ranking.top_percent(self.percent), ranking.at_least(self.floor));
        Ok(round.grow(if by_rank.len() < by_floor.len() { by_rank } else { by_floor }, rng))
    }

    fn statistics(&self) -> Statistics {
        self.signal.statistics()
    }

    fn needs_residual(&self) -> bool {
        false
    }
}
