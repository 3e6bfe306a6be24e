//! Growth above an absolute threshold on the gradient, as 3DGS has it.

use gs_core::{EditPlan, Error, effects::Statistics};
use serde::{Deserialize, Serialize};

use crate::{
    gaussian::DensityScene,
    observation::{DensityPolicy, Observation, Rng},
    ranking::WhenFlat,
    round::{Actions, Round},
    signal::Signal,
};

/// Every Gaussian grows whose signal is at least a threshold (*source:* 3DGS, by its mean positional gradient; AbsGS by the absolute one).
///
/// The paper (§5.2) shows its weakness: how large gradients are depends on the image's contrast and on the loss, and a blurry fit
/// may have none above the threshold; growth then ends too early. Gradients of 0 never grow, whatever the threshold.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", from = "Partial")]
pub struct AbsoluteThreshold {
    /// What calls for growth. Default the mean gradient.
    pub signal: Signal,
    /// τ, in the signal's unit; not negative. Default [`Signal::threshold`]; in a settings file, that of the signal named there.
    pub threshold: f32,
    /// What is done to the Gaussians.
    pub actions: Actions,
}

impl Default for AbsoluteThreshold {
    fn default() -> Self {
        Self::by(Signal::default())
    }
}

/// A settings file's form: what is missing depends on what is there.
#[derive(Default, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
struct Partial {
    signal: Signal,
    threshold: Option<f32>,
    actions: Actions,
}

impl From<Partial> for AbsoluteThreshold {
    fn from(Partial { signal, threshold, actions }: Partial) -> Self {
        Self { signal, threshold: threshold.unwrap_or(signal.threshold()), actions }
    }
}

impl AbsoluteThreshold {
    /// The defaults by this signal.
    pub fn by(signal: Signal) -> Self {
        Self { signal, threshold: signal.threshold(), actions: Actions::default() }
    }

    /// Fails where a number is outside its range.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first offender.
    pub fn validate(&self) -> Result<(), Error> {
        check_threshold("threshold", self.threshold)?;
        self.actions.validate()
    }
}

impl<S: DensityScene> DensityPolicy<S> for AbsoluteThreshold {
    fn plan(&self, observation: &Observation<'_, S>, rng: &mut Rng) -> Result<EditPlan<S::Gaussian>, Error> {
        self.validate()?;
        let round = Round::open(&self.actions, observation)?;
        let ranking = round.rank_by_statistic(WhenFlat::Nothing);
        Ok(round.grow(ranking.at_least(self.threshold), rng))
    }

    fn statistics(&self) -> Statistics {
        self.signal.statistics()
    }

    fn needs_residual(&self) -> bool {
        false
    }
}

/// Fails for NaN and below 0; +∞ is a threshold that nothing reaches.
pub(crate) fn check_threshold(what: &'static str, value: f32) -> Result<(), Error> {
    if value >= 0.0 { Ok(()) } else { Err(Error::setting(what, value, "0 or more")) }
}
