//! How many Gaussians the optimiser's bounds of scales hold back.

use serde::{Deserialize, Serialize};

use crate::task::{RunSettings, Trainable};

/// A scale within this of a bound, as a difference of logarithms, is at it: scales that are read back from a covariance factor are rounded.
const AT_BOUND: f32 = 1e-3;

/// Gaussians with a scale at a bound of [`Adam`](gs_core::Adam). They would be smaller, or larger, if they were let; many of the
/// largest are the mark of learning rates that are too high.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Clamped {
    /// Those with a scale at [`Adam::min_scale`](gs_core::Adam).
    pub smallest: u32,
    /// Those with a scale at [`Adam::max_scale`](gs_core::Adam).
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

    /// Both together; a Gaussian that is at both bounds counts twice.
    pub fn total(self) -> u64 {
        u64::from(self.smallest) + u64::from(self.largest)
    }
}
