//! The signals by which growth is decided.

use gs_core::{
    constants::{TAU_ABSOLUTE, TAU_ERROR, TAU_POSITION},
    effects::Statistics,
};
use serde::{Deserialize, Serialize};

/// γ_depth of Pixel-GS (Zhang et al. 2024), extents.
const FULL_DEPTH: f32 = 0.37;

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
    /// The pixel-aware gradient of Pixel-GS, normalised device units: the positional gradient,
    /// averaged over views by the number of pixels, so that views that show only the edge of a
    /// large Gaussian count little.
    PixelGradient,
    /// The pixel error of Rota Bulò et al., px: the part of the image's error that falls to a
    /// Gaussian.
    PixelError,
}

impl Signal {
    /// Statistic that training must collect.
    pub(crate) fn statistics(self) -> Statistics {
        match self {
            Self::MeanGradient => Statistics::MeanGradient,
            Self::AbsoluteGradient => Statistics::AbsoluteGradient,
            Self::PixelGradient => Statistics::PixelGradient,
            Self::PixelError => Statistics::PixelError,
        }
    }

    /// Default growth threshold, in the signal's unit: [`TAU_POSITION`], [`TAU_ABSOLUTE`] or
    /// [`TAU_ERROR`].
    pub(crate) fn threshold(self) -> f32 {
        match self {
            Self::MeanGradient | Self::PixelGradient => TAU_POSITION,
            Self::AbsoluteGradient => TAU_ABSOLUTE,
            Self::PixelError => TAU_ERROR,
        }
    }

    /// Depth from which gradients count fully by default, in extents of the scene: 0.37 for the
    /// pixel-aware gradient (*source:* Pixel-GS), 0 for all others.
    pub(crate) fn full_depth(self) -> f32 {
        if self == Self::PixelGradient { FULL_DEPTH } else { 0.0 }
    }
}
