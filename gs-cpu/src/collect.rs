//! The sums over pixels that some densification statistics need besides the gradients.
//!
//! Each statistic is a type, so that a kernel without such sums is compiled without code for them.

use gs_core::effects::Statistics;

/// The numbers per entry that a backward kernel writes after its gradients.
pub(crate) trait Collect {
    /// Count of the numbers.
    const NUMBERS: usize = 0;
    /// Whether the numbers include Σ|∂L/∂u| and Σ|∂L/∂v|, px⁻¹, summed over pixels.
    const ABSOLUTE: bool = false;
    /// Whether the numbers include Σ T α e, where e is the pixel's error.
    const ERROR: bool = false;
    /// Whether the number counts the pixels in which the Gaussian is blended.
    const COUNT: bool = false;
}

/// No further numbers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Nothing;

/// [`Statistics::AbsoluteGradient`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct AbsoluteGradients;

/// [`Statistics::PixelError`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct PixelErrors;

/// [`Statistics::PixelGradient`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct PixelCounts;

impl Collect for Nothing {}

impl Collect for AbsoluteGradients {
    const NUMBERS: usize = 2;
    const ABSOLUTE: bool = true;
}

impl Collect for PixelErrors {
    const NUMBERS: usize = 1;
    const ERROR: bool = true;
}

impl Collect for PixelCounts {
    const NUMBERS: usize = 1;
    const COUNT: bool = true;
}

/// The [`Collect::NUMBERS`] of a statistic.
pub(crate) fn numbers(statistics: Statistics) -> usize {
    match statistics {
        Statistics::None | Statistics::MeanGradient => Nothing::NUMBERS,
        Statistics::AbsoluteGradient => AbsoluteGradients::NUMBERS,
        Statistics::PixelGradient => PixelCounts::NUMBERS,
        Statistics::PixelError => PixelErrors::NUMBERS,
    }
}

/// Compiles `$body` once per statistic, with `$kind` as its [`Collect`] type.
macro_rules! collecting {
    ($statistics:expr, $kind:ident => $body:expr) => {
        match $statistics {
            gs_core::effects::Statistics::None | gs_core::effects::Statistics::MeanGradient => {
                type $kind = crate::collect::Nothing;
                $body
            }
            gs_core::effects::Statistics::AbsoluteGradient => {
                type $kind = crate::collect::AbsoluteGradients;
                $body
            }
            gs_core::effects::Statistics::PixelGradient => {
                type $kind = crate::collect::PixelCounts;
                $body
            }
            gs_core::effects::Statistics::PixelError => {
                type $kind = crate::collect::PixelErrors;
                $body
            }
        }
    };
}
pub(crate) use collecting;
