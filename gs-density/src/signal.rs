//! By which of the collected statistics a policy tells who calls for growth.

use gs_core::{
    constants::{TAU_ABSOLUTE, TAU_ERROR, TAU_POSITION},
    effects::Statistics,
};
use serde::{Deserialize, Serialize};

/// What a Gaussian's call for growth is measured by: the mean, over the steps in which it was drawn, of one statistic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Signal {
    /// The positional gradient of 3DGS, normalised device units: how much a Gaussian is pulled to one side. One that is pulled to all
    /// sides at once, because it is too large for what it covers, has none.
    #[default]
    MeanGradient,
    /// The absolute gradient of AbsGS, normalised device units: pulls to opposite sides add up, so that large Gaussians over fine detail
    /// are seen.
    AbsoluteGradient,
    /// The pixel error of Rota Bulò et al., px: how much of the picture's error a Gaussian stands for, whichever way it is pulled.
    PixelError,
}

impl Signal {
    /// What training must collect for it.
    pub fn statistics(self) -> Statistics {
        match self {
            Self::MeanGradient => Statistics::MeanGradient,
            Self::AbsoluteGradient => Statistics::AbsoluteGradient,
            Self::PixelError => Statistics::PixelError,
        }
    }

    /// The threshold of growth that comes with it, in its unit: [`TAU_POSITION`], [`TAU_ABSOLUTE`] or [`TAU_ERROR`].
    pub fn threshold(self) -> f32 {
        match self {
            Self::MeanGradient => TAU_POSITION,
            Self::AbsoluteGradient => TAU_ABSOLUTE,
            Self::PixelError => TAU_ERROR,
        }
    }
}
