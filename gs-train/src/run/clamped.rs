//! Counts of Gaussians whose scales are at the optimizer's bounds.

use serde::{Deserialize, Serialize};

use super::task::{RunSettings, Trainable};

/// Difference of logarithms within which a scale is at a bound, as scales from a covariance factor
/// are rounded.
const AT_BOUND: f32 = 1e-3;

/// Numbers of Gaussians with a scale at a bound of [`Adam`](gs_core::Adam).
///
/// Without the bounds they would be smaller or larger. Many at the upper bound are a sign of
/// learning rates that are too high.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Clamped {
    /// Gaussians with a scale at [`Adam::min_scale`](gs_core::Adam).
    pub smallest: u32,
    /// Gaussians with a scale at [`Adam::max_scale`](gs_core::Adam).
    pub largest: u32,
}

impl Clamped {
    pub(crate) fn of<S: Trainable>(scene: &S, settings: &S::Settings) -> Self {
        let (lower, upper) = settings.scale_bounds();
        let (lower, upper) = (lower.ln() + AT_BOUND, upper.ln() - AT_BOUND);
        let mut clamped = Self::default();
        for (shortest, longest) in (0..scene.len()).map(|index| scene.log_scale_range(index)) {
            clamped.smallest += u32::from(shortest <= lower);
            clamped.largest += u32::from(longest >= upper);
        }
        clamped
    }
}
