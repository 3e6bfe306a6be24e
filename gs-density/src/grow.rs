//! Growth of the Gaussians that call for it most: by rank, above a threshold, or both.

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

/// The share of [`Signal::threshold`] below which [`Grow::hybrid`] lets nothing grow.
const FLOOR_SHARE: f32 = 0.01;

/// How rank and threshold are combined.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum Combine {
    /// A Gaussian grows that is among the first by rank and reaches the threshold.
    #[default]
    Both,
    /// A Gaussian grows that is among the first by rank or reaches the threshold.
    Either,
}

/// Growth by rank and threshold. Gaussians are ranked by a signal; the first few of them grow, and how many that is follows from
/// a share of all and from a threshold.
///
/// | constructor | percent | threshold | combine | *source* |
/// |---|---|---|---|---|
/// | [`Grow::absolute`] | 100 | that of the signal | both | 3DGS by the mean gradient, AbsGS by the absolute one |
/// | [`Grow::percentile`] | 10 | 0 | both | the paper's forced growth, §3.4.3 and §5.2 |
/// | [`Grow::hybrid`] | 10 | a hundredth of the signal's | both | – |
/// | [`Grow::paper`] | 10 | that of the signal | either | the paper's experiment, §3.4.3 |
///
/// A settings file names the constructor as `kind`; keys that it leaves out have the values of this table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grow {
    /// What calls for growth.
    pub signal: Signal,
    /// Share of the Gaussians left after pruning that the rank lets grow in each round, rounded up, so at least one. 0..=100 %; at
    /// 0, the rank lets none grow.
    pub percent: f32,
    /// The least signal that grows, in its unit; not negative. ∞ is a threshold that nothing reaches. A signal of 0 never reaches it.
    pub threshold: f32,
    /// Whether rank and threshold must both allow growth, or one of them.
    pub combine: Combine,
    /// What the rank does with Gaussians whose signal is 0, where the threshold does not stop them. Default nothing.
    pub when_flat: WhenFlat,
    /// What is done to the Gaussians.
    pub actions: Actions,
}

impl Grow {
    /// Every Gaussian grows whose signal is at least the signal's threshold.
    ///
    /// The paper (§5.2) shows the weakness of a threshold: how large gradients are depends on the image's contrast and on the loss,
    /// and a blurry fit may have none above it; growth then ends too early.
    pub fn absolute(signal: Signal) -> Self {
        Self { percent: 100.0, threshold: signal.threshold(), ..Self::percentile(signal) }
    }

    /// The Gaussians with the largest signals grow, [`FORCED_GROWTH_PERCENT`] of them, regardless of a threshold.
    ///
    /// The count rises by that share a round: from 20 by 10 % in 24 rounds to 234, rounding up included.
    pub fn percentile(signal: Signal) -> Self {
        Self {
            signal,
            percent: FORCED_GROWTH_PERCENT,
            threshold: 0.0,
            combine: Combine::Both,
            when_flat: WhenFlat::Nothing,
            actions: Actions::default(),
        }
    }

    /// Of the first [`FORCED_GROWTH_PERCENT`] by rank, those grow whose signal is at least a hundredth of its threshold.
    ///
    /// The rank sets the pace, whatever the contrast of the image; the floor, far below 3DGS's threshold, only ends growth where there
    /// is nothing to gain; and the budget is a target: the round that reaches it ends at exactly that many.
    pub fn hybrid(signal: Signal) -> Self {
        Self { threshold: FLOOR_SHARE * signal.threshold(), ..Self::percentile(signal) }
    }

    /// The first [`FORCED_GROWTH_PERCENT`] by rank grow, and all whose signal is at least its threshold.
    ///
    /// The paper (§3.4.3) forces the first 10 % to grow "regardless of an absolute threshold" and goes from 20 Gaussians to 600. Were
    /// that all, 24 rounds would end at 234; so the threshold must have been at work, too. While gradients are above it the count
    /// doubles each round, and forced growth carries on where they no longer are.
    pub fn paper(signal: Signal) -> Self {
        Self { threshold: signal.threshold(), combine: Combine::Either, ..Self::percentile(signal) }
    }

    /// The same with other actions.
    #[must_use]
    pub fn with_actions(self, actions: Actions) -> Self {
        Self { actions, ..self }
    }

    /// Fails where a number is outside its range.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first offender.
    pub fn validate(&self) -> Result<(), Error> {
        check_percent(self.percent)?;
        if !(self.threshold >= 0.0) {
            return Err(Error::setting("threshold", self.threshold, "0 or more"));
        }
        self.actions.validate()
    }
}

impl<S: DensityScene> DensityPolicy<S> for Grow {
    fn plan(&self, observation: &Observation<'_, S>, rng: &mut Rng) -> Result<EditPlan<S::Gaussian>, Error> {
        self.validate()?;
        let round = Round::open(&self.actions, observation)?;
        let ranking = round.rank_by_statistic(self.when_flat);
        let by_rank = ranking.top_percent(self.percent);
        // Both are the head of one ranking, so the shorter is what they have in common, and the longer their union.
        let candidates = match self.combine {
            Combine::Both => {
                let by_threshold = ranking.at_least(self.threshold);
                if by_rank.len() < by_threshold.len() { by_rank } else { by_threshold }
            }
            Combine::Either => {
                // Gaussians without a signal grow by rank alone, even at a threshold of 0.
                let by_threshold = ranking.at_least(self.threshold.max(f32::MIN_POSITIVE));
                if by_rank.len() > by_threshold.len() { by_rank } else { by_threshold }
            }
        };
        Ok(round.grow(candidates, rng))
    }

    fn statistics(&self) -> Statistics {
        self.signal.statistics()
    }

    fn needs_residual(&self) -> bool {
        false
    }
}

/// [`Grow`] in a settings file, beside the `kind` that says what missing keys are.
#[derive(Default, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct GrowForm {
    signal: Signal,
    percent: Option<f32>,
    #[serde(alias = "floor")]
    threshold: Option<f32>,
    when_flat: WhenFlat,
    actions: Actions,
}

impl GrowForm {
    /// What the file says, and what `usual` has in place of the rest.
    pub(crate) fn or(self, usual: fn(Signal) -> Grow) -> Grow {
        let Self { signal, percent, threshold, when_flat, actions } = self;
        let usual = usual(signal);
        let (percent, threshold) = (percent.unwrap_or(usual.percent), threshold.unwrap_or(usual.threshold));
        Grow { percent, threshold, when_flat, actions, ..usual }
    }
}

impl From<Grow> for GrowForm {
    fn from(Grow { signal, percent, threshold, when_flat, actions, .. }: Grow) -> Self {
        Self { signal, percent: Some(percent), threshold: Some(threshold), when_flat, actions }
    }
}

/// How many grow in a round of which `percent` % of so many may: rounded up, so at least one, unless `percent` is 0.
pub fn share_of(count: usize, percent: f32) -> usize {
    if percent >= 100.0 {
        return count;
    }
    let exact = count as f64 * f64::from(percent) / 100.0;
    // A percentage that f32 holds a little too large, such as 0.1, must not round a whole number up to the next.
    (exact * (1.0 - f64::from(f32::EPSILON))).ceil() as usize
}

/// Fails unless `value` is a percentage.
pub(crate) fn check_percent(value: f32) -> Result<(), Error> {
    if (0.0..=100.0).contains(&value) { Ok(()) } else { Err(Error::setting("percent", value, "0 to 100")) }
}
