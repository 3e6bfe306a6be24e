//! What the backward kernels sum up besides the gradients, for the statistics that need sums of their own; kernels which collect nothing
//! are compiled without a trace of it.

use gs_core::effects::Statistics;

/// Numbers that follow an entry's gradients in its slot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub(crate) enum Collected {
    /// None: the gradients are enough.
    #[default]
    Nothing,
    /// Σ|∂L/∂u| and Σ|∂L/∂v|, px⁻¹: the positional gradient's shares through single pixels, by magnitude.
    AbsoluteGradients,
    /// Σ T α e, e the pixels' errors.
    PixelErrors,
}

impl Collected {
    /// What a statistic needs.
    pub(crate) fn of(statistics: Statistics) -> Self {
        match statistics {
            Statistics::None | Statistics::MeanGradient => Self::Nothing,
            Statistics::AbsoluteGradient => Self::AbsoluteGradients,
            Statistics::PixelError => Self::PixelErrors,
        }
    }

    /// How many numbers.
    pub(crate) fn numbers(self) -> u32 {
        match self {
            Self::Nothing => 0,
            Self::AbsoluteGradients => 2,
            Self::PixelErrors => 1,
        }
    }
}
