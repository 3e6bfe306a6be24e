//! Growth by score: by rank, above a threshold, or both.

mod named;

use gs_core::{EditPlan, Error};

pub(crate) use self::named::{GrowForm, NAMED, kind, name};

use super::rule::Rule as _;
use crate::{
    observation::{DensityPolicy, DensityScene, Needs, Observation, Rng, Signal},
    round::{Actions, Densify, Round, SizeThreshold, WhenFlat},
};

gs_core::impl_with!(Grow);

/// Share of the Gaussians that forced growth lets grow in each round, %. *Source:* paper §3.4.3.
pub const FORCED_GROWTH_PERCENT: f32 = 10.0;

/// How rank and threshold are combined.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum Combine {
    /// A Gaussian grows if it is among the first by rank and reaches the threshold.
    #[default]
    Both,
    /// A Gaussian grows if it is among the first by rank or reaches the threshold.
    Either,
}

/// Growth by rank and threshold: Gaussians are ranked by a signal, and the first grow, up to a
/// share of all and down to a threshold.
///
/// | constructor | percent | threshold | combine | *source* |
/// |---|---|---|---|---|
/// | [`Grow::absolute`] | 100 | that of the signal | both | 3DGS by the mean gradient, AbsGS by the absolute one |
/// | [`Grow::percentile`] | 10 | 0 | both | the paper's forced growth, §3.4.3 and §5.2 |
/// | [`Grow::paper`] | 10 | that of the signal | either | the paper's experiment, §3.4.3 |
///
/// A settings file names the constructor as `kind`; missing keys have the values of this table.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Grow {
    /// Signal by which Gaussians are ranked.
    pub signal: Signal,
    /// Share of the Gaussians left after pruning that the rank lets grow in each round, 0..=100 %,
    /// rounded up; at 0 none.
    pub percent: f32,
    /// Least signal that grows, in its unit; not negative. Nothing reaches ∞, and a signal of 0
    /// never reaches the threshold.
    pub threshold: f32,
    /// Whether rank and threshold must both allow growth, or one of them.
    pub combine: Combine,
    /// What the rank does with Gaussians whose signal is 0, where the threshold does not stop them.
    /// Default nothing.
    pub when_flat: WhenFlat,
    /// Depth from which gradients count fully, in extents of the scene; nearer ones count by the
    /// square of the ratio, so that few Gaussians grow close to a camera (*source:* Pixel-GS). Only
    /// for [`Signal::PixelGradient`] in 3D. Not negative. Default: 0.37, the value of Pixel-GS, for
    /// that signal, and 0 for the others.
    pub full_depth: f32,
    /// What is done to the Gaussians.
    pub actions: Actions,
}

impl Grow {
    /// Every Gaussian grows whose signal is at least the signal's threshold.
    ///
    /// The paper (§5.2) shows the weakness of a threshold: the size of gradients depends on the
    /// image's contrast and on the loss, and a blurry fit may have none above it; growth then ends
    /// too early.
    pub fn absolute(signal: Signal) -> Self {
        Self { percent: 100.0, threshold: signal.threshold(), ..Self::percentile(signal) }
    }

    /// [`Self::absolute`] by the absolute gradient, where Gaussians larger than a thousandth of the
    /// extent are split, a tenth of the bound of 3DGS: nearly all that grow.
    ///
    /// *Source:* the code of AbsGS. (It picks clones by the mean gradient, a second statistic; there
    /// are hardly any.)
    pub fn abs_gs() -> Self {
        let densify = Densify { split_above: SizeThreshold::ExtentFraction(1e-3), ..Densify::default() };
        Self::absolute(Signal::AbsoluteGradient).with_actions(Actions { densify, ..Actions::default() })
    }

    /// The Gaussians with the largest signals grow, [`FORCED_GROWTH_PERCENT`] of them, regardless
    /// of a threshold. With a low threshold, growth ends where there is nothing to gain, and the
    /// budget is a target: the round that reaches it ends at exactly that number.
    ///
    /// The count rises by that share a round: from 20 by 10 % in 24 rounds to 234, rounding up
    /// included.
    pub fn percentile(signal: Signal) -> Self {
        Self {
            signal,
            percent: FORCED_GROWTH_PERCENT,
            threshold: 0.0,
            combine: Combine::Both,
            when_flat: WhenFlat::Nothing,
            full_depth: signal.full_depth(),
            actions: Actions::default(),
        }
    }

    /// Growth by rank or threshold: the first [`FORCED_GROWTH_PERCENT`] by rank grow, and all whose
    /// signal is at least its threshold.
    ///
    /// The paper (§3.4.3) forces the first 10 % to grow "regardless of an absolute threshold" and
    /// goes from 20 Gaussians to 600. By forced growth alone, 24 rounds would end at 234, so the
    /// threshold must have been used, too. While gradients are above it, the number doubles each
    /// round; then forced growth continues.
    pub fn paper(signal: Signal) -> Self {
        Self { threshold: signal.threshold(), combine: Combine::Either, ..Self::percentile(signal) }
    }

    /// Returns this policy with other actions.
    #[must_use]
    pub fn with_actions(self, actions: Actions) -> Self {
        Self { actions, ..self }
    }
}

impl<S: DensityScene> DensityPolicy<S> for Grow {
    fn plan(&self, observation: &Observation<'_, S>, rng: &mut Rng) -> Result<EditPlan<S::Gaussian>, Error> {
        self.validate()?;
        let round = Round::open(&self.actions, observation)?;
        let ranking = round.rank_by_statistic(self.when_flat);
        let by_rank = ranking.top_percent(self.percent);
        // Both are the head of one ranking, so the shorter is what they have in common, and the
        // longer their union.
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

    fn needs(&self) -> Needs {
        Needs { statistics: self.signal.statistics(), full_depth: self.full_depth, ..Needs::default() }
    }
}
