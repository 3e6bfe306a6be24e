//! The signals by which growth is decided.

use gs_core::{
    constants::{TAU_ABSOLUTE, TAU_ERROR, TAU_POSITION},
    effects::Statistics,
};
use serde::{Deserialize, Serialize};

/// Signal by which growth is decided: the mean of one statistic over the steps in which a Gaussian
/// was drawn. Exhaustive: each is a statistic that backends collect.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Signal {
    /// The positional gradient of 3DGS, normalised device units. Pulls to opposite sides cancel, so
    /// a Gaussian that is too large for what it covers may have none.
    #[default]
    MeanGradient,
    /// The absolute gradient of AbsGS, normalised device units. Pulls to opposite sides add up, so
    /// that large Gaussians over fine detail have a large signal.
    AbsoluteGradient,
    /// The pixel error of Rota Bulò et al., px: the part of the image's error that falls to a
    /// Gaussian.
    PixelError,
}

impl Signal {
    /// Statistic that training must collect.
    pub fn statistics(self) -> Statistics {
        match self {
            Self::MeanGradient => Statistics::MeanGradient,
            Self::AbsoluteGradient => Statistics::AbsoluteGradient,
            Self::PixelError => Statistics::PixelError,
        }
    }

    /// Default growth threshold, in the signal's unit: [`TAU_POSITION`], [`TAU_ABSOLUTE`] or
    /// [`TAU_ERROR`].
    pub fn threshold(self) -> f32 {
        match self {
            Self::MeanGradient => TAU_POSITION,
            Self::AbsoluteGradient => TAU_ABSOLUTE,
            Self::PixelError => TAU_ERROR,
        }
    }
}
