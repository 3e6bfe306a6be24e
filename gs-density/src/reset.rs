//! The periodic reset of all opacities, which makes every Gaussian prove itself anew.

use gs_core::{
    Error,
    constants::{OPACITY_RESET_EVERY, OPACITY_RESET_TO},
};
use serde::{Deserialize, Serialize};

use crate::{gaussian::DensityScene, observation::Observation};

/// When opacities are reset, and to what. *Source:* paper §2.2.3, 3DGS.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub struct OpacityReset {
    /// Steps from one reset to the next; 0 for never. Default [`OPACITY_RESET_EVERY`]. A policy acts only when it is asked, so this
    /// should be a multiple of the steps between two rounds.
    pub every: u32,
    /// Once more after this step, counted from 1; 0 for never, the default. 3DGS does so at its first round where the background is white, which
    /// thins the fog that a start at random is. A multiple of the steps between two rounds, too.
    pub once_after: u32,
    /// What every opacity is lowered to at most, above 0 and at most 1. Default [`OPACITY_RESET_TO`]. At less than
    /// [`Prune::opacity`](crate::Prune::opacity), all Gaussians that do not recover until the next round are pruned.
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

    /// The ceiling for this round's plan: `every` steps have passed, or a multiple of them, or just `once_after`, the scene has opacities,
    /// and rounds are left to prune what does not recover (3DGS resets only before the end of densification, too).
    pub fn ceiling<S: DensityScene>(&self, observation: &Observation<'_, S>) -> Option<f32> {
        let steps = u64::from(observation.step) + 1;
        let recurs = self.every > 0 && steps.is_multiple_of(u64::from(self.every));
        let is_due = recurs || (self.once_after > 0 && steps == u64::from(self.once_after));
        (is_due && observation.progress < 1.0 && observation.scene.has_opacity()).then_some(self.to)
    }

    /// Fails where a number is outside its range.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the offender.
    pub fn validate(&self) -> Result<(), Error> {
        if self.to > 0.0 && self.to <= 1.0 {
            return Ok(());
        }
        Err(Error::setting("reset.to", self.to, "above 0 and at most 1"))
    }
}
