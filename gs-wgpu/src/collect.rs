//! The sums over pixels that some densification statistics need besides the gradients. Kernels
//! without such sums are compiled without code for them.

use gs_core::effects::Statistics;

/// Numbers that follow an entry's gradients in its slot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub(crate) enum Collected {
    /// No further numbers.
    #[default]
    Nothing,
    /// Σ|∂L/∂u| and Σ|∂L/∂v|, px⁻¹, summed over pixels.
    AbsoluteGradients,
    /// The number of pixels in which the Gaussian is blended.
    PixelCounts,
    /// Σ T α e, where e is the pixel's error.
    PixelErrors,
}

impl Collected {
    /// The numbers that a statistic needs.
    pub(crate) fn of(statistics: Statistics) -> Self {
        match statistics {
            Statistics::None | Statistics::MeanGradient => Self::Nothing,
            Statistics::AbsoluteGradient => Self::AbsoluteGradients,
            Statistics::PixelGradient => Self::PixelCounts,
            Statistics::PixelError => Self::PixelErrors,
        }
    }

    /// Count of the numbers.
    pub(crate) fn numbers(self) -> u32 {
        match self {
            Self::Nothing => 0,
            Self::AbsoluteGradients => 2,
            Self::PixelCounts | Self::PixelErrors => 1,
        }
    }
}
