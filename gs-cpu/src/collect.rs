//! What the backward kernels sum up besides the gradients, for the statistics that need sums of their own: a type per statistic, so
//! that kernels which collect nothing are compiled without a trace of it.

use gs_core::effects::Statistics;

/// Which further numbers a backward kernel yields per entry, behind those of its gradients.
pub(crate) trait Collect {
    /// How many.
    const NUMBERS: usize;
    /// Whether Σ|∂L/∂u| and Σ|∂L/∂v|, px⁻¹, are among them: the positional gradient's shares through single pixels, by magnitude.
    const ABSOLUTE: bool;
    /// Whether Σ T α e is, e from a buffer of errors.
    const ERROR: bool;
}

/// Nothing: the gradients are enough.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Nothing;

/// [`Statistics::AbsoluteGradient`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct AbsoluteGradients;

/// [`Statistics::PixelError`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct PixelErrors;

impl Collect for Nothing {
    const NUMBERS: usize = 0;
    const ABSOLUTE: bool = false;
    const ERROR: bool = false;
}

impl Collect for AbsoluteGradients {
    const NUMBERS: usize = 2;
    const ABSOLUTE: bool = true;
    const ERROR: bool = false;
}

impl Collect for PixelErrors {
    const NUMBERS: usize = 1;
    const ABSOLUTE: bool = false;
    const ERROR: bool = true;
}

/// The [`Collect::NUMBERS`] of a statistic.
pub(crate) fn numbers(statistics: Statistics) -> usize {
    match statistics {
        Statistics::None | Statistics::MeanGradient => Nothing::NUMBERS,
        Statistics::AbsoluteGradient => AbsoluteGradients::NUMBERS,
        Statistics::PixelError => PixelErrors::NUMBERS,
    }
}

/// Compiles `$body` once per statistic, with `$kind` standing for the type of what is collected.
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
            gs_core::effects::Statistics::PixelError => {
                type $kind = crate::collect::PixelErrors;
                $body
            }
        }
    };
}
pub(crate) use collecting;
