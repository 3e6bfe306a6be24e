//! The periodic reset of all opacities.

use gs_core::{
    Error,
    constants::{OPACITY_RESET_EVERY, OPACITY_RESET_TO},
};
use serde::{Deserialize, Serialize};

use crate::observation::{DensityScene, Observation};

gs_core::impl_with!(OpacityReset);

/// Settings of opacity resets. *Source:* paper §2.2.3, 3DGS.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
#[non_exhaustive]
pub struct OpacityReset {
    /// Steps from one reset to the next; 0 for never. Default [`OPACITY_RESET_EVERY`]. Resets
    /// happen in rounds only, so this should be a multiple of the steps between two rounds.
    pub every: u32,
    /// Step, counted from 1, of an extra reset; 0 for none, the default. Also a multiple of the
    /// steps between two rounds.
    ///
    /// 3DGS does one at its first round where the background is white, which removes fog of a
    /// random start.
    pub once_after: u32,
    /// Largest opacity after a reset, above 0 and at most 1. Default [`OPACITY_RESET_TO`]. Below
    /// [`Prune::opacity`](crate::Prune::opacity), all Gaussians that do not recover until the next
    /// round are pruned.
    pub to: f32,
}

impl Default for OpacityReset {
    fn default() -> Self {
        Self { every: OPACITY_RESET_EVERY, once_after: 0, to: OPACITY_RESET_TO }
    }
}

impl OpacityReset {
    /// No reset.
    pub const NEVER: Self = Self { every: 0, once_after: 0, to: OPACITY_RESET_TO };

    /// The opacity ceiling of this round's plan, where a reset is due, the scene has opacities, and
    /// rounds are left to prune Gaussians that do not recover (3DGS resets only before the end of
    /// densification, too).
    pub(crate) fn ceiling<S: DensityScene>(&self, observation: &Observation<'_, S>) -> Option<f32> {
        let steps = u64::from(observation.step) + 1;
        let recurs = self.every > 0 && steps.is_multiple_of(u64::from(self.every));
        let is_due = recurs || (self.once_after > 0 && steps == u64::from(self.once_after));
        (is_due && observation.progress < 1.0 && observation.scene.has_opacity()).then_some(self.to)
    }

    /// Checks the ranges of all settings.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first value outside its range.
    pub(crate) fn validate(&self) -> Result<(), Error> {
        Error::within("reset.to", self.to, f32::MIN_POSITIVE..=1.0, "above 0 and at most 1")
    }
}
