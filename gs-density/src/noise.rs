//! Noise on the means between steps, by which 3DGS-MCMC explores: stochastic gradient Langevin
//! dynamics.

use gs_core::{Error, MeanNoise};
use serde::{Deserialize, Serialize};

use crate::observation::DensityScene;

gs_core::impl_with!(Noise);

/// λ_noise · (the position's learning rate at the start, per extent of the scene) of 3DGS-MCMC's
/// code: 5·10⁵ · 1.6·10⁻⁴.
const STRENGTH: f32 = 80.0;

/// Noise on the means after steps: [`MeanNoise`] of scale rate · strength · extent (*source:*
/// 3DGS-MCMC, Kheradmand et al. 2024, with the numbers of its code).
///
/// The rate is the learning rate of means relative to its first value. In 2D scenes the noise is
/// divided by the extent, the image's longer side, so that images of any size behave alike. Only
/// Gaussians that are almost invisible move, mostly along their long axis; visible ones stay. In a
/// scene without opacities nothing moves.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
#[non_exhaustive]
pub struct Noise {
    /// Strength, not negative; default 80. 0 means no noise.
    pub strength: f32,
    /// Steps from one addition to the next, at least 1; default 1. The noise of several steps is
    /// added at once, √every times as large.
    pub every: u32,
}

impl Default for Noise {
    fn default() -> Self {
        Self { strength: STRENGTH, every: 1 }
    }
}

impl Noise {
    /// No noise.
    pub const NONE: Self = Self { strength: 0.0, every: 1 };

    /// Whether noise is added after step `steps`, counted from 1.
    pub fn is_due(&self, steps: u32) -> bool {
        self.strength > 0.0 && self.every > 0 && steps.is_multiple_of(self.every)
    }

    /// The noise after step `step`, counted from 1, of a run with this seed. `rate` is the learning
    /// rate of means relative to its first value; `extent` is the size of the scene.
    pub fn of_step<S: DensityScene>(&self, extent: f32, rate: f32, seed: u32, step: u32) -> MeanNoise {
        let scale = S::noise_factor(self.strength * rate * (self.every as f32).sqrt(), extent);
        MeanNoise { scale, seed, step, fixed: 0 }
    }

    /// Checks the ranges of all settings.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first value outside its range.
    pub(crate) fn validate(&self) -> Result<(), Error> {
        Error::within("noise.strength", self.strength, 0.0..=f32::MAX, "0 or more, and finite")?;
        Error::within("noise.every", self.every, 1.., "at least 1")
    }
}

#[cfg(test)]
mod tests {
    use gs_core::{Scene2d, Scene3d};

    use super::*;

    #[test]
    fn strength_is_by_the_extent_and_several_steps_come_at_once() {
        let noise = Noise { strength: 50.0, every: 4 };
        let expected = MeanNoise { scale: 50.0 * 0.5 * 2.0 / 200.0, seed: 3, step: 8, fixed: 0 };
        assert_eq!(noise.of_step::<Scene2d>(200.0, 0.5, 3, 8), expected);
        let expected = MeanNoise { scale: 50.0 * 0.5 * 2.0 * 4.0, seed: 3, step: 8, fixed: 0 };
        assert_eq!(noise.of_step::<Scene3d>(4.0, 0.5, 3, 8), expected);
    }

    #[test]
    fn noise_comes_when_it_is_due_and_bad_numbers_are_refused() {
        assert!(!Noise::NONE.is_due(1) && Noise { every: 3, ..Noise::default() }.is_due(6));
        assert!(Noise { every: 0, ..Noise::default() }.validate().is_err());
        assert!(Noise { strength: f32::NAN, ..Noise::default() }.validate().is_err());
    }
}
