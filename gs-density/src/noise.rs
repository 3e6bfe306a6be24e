//! Noise on the means between steps, by which 3DGS-MCMC explores: stochastic gradient Langevin dynamics.

use gs_core::{Error, scene::sigmoid};
use serde::{Deserialize, Serialize};

use crate::{
    gaussian::{DensityGaussian, DensityScene},
    observation::Rng,
};

/// λ_noise · (the position's learning rate at the start, per extent of the scene) of 3DGS-MCMC's code: 5·10⁵ · 1.6·10⁻⁴.
const STRENGTH: f32 = 80.0;

/// k of 3DGS-MCMC: how sharply the noise ends where opacity begins.
const STEEPNESS: f32 = 100.0;

/// t of 3DGS-MCMC (1 − t in its code): the opacity at which the noise has half its strength.
const OPACITY: f32 = 0.005;

/// What is added to a mean after a step: rate · strength · extent · s(−100 (o − 0.005)) · Σ η, with η standard normal and s the logistic
/// function (*source:* the noise of 3DGS-MCMC, Kheradmand et al. 2024, with its code's numbers).
///
/// The rate is the position's learning rate relative to its first value. In 2D scenes the noise is divided by the extent, the
/// image's longer side, so that images of any size behave alike. Only Gaussians that have all but vanished move, by much and mostly along their long axis; those that are seen stay.
/// In a scene without opacities nothing moves.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub struct Noise {
    /// Strength, not negative; default 80. At 0 there is none.
    pub strength: f32,
    /// Steps from one injection to the next, at least 1; default 1. Several steps' noise comes at once, √every times as large.
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

    /// Whether noise follows the step `steps`, counted from 1.
    pub fn is_due(&self, steps: u32) -> bool {
        self.strength > 0.0 && self.every > 0 && steps.is_multiple_of(self.every)
    }

    /// What to add to every mean, `[N, 2]` px or `[N, 3]` world units, row-major; nothing where the scene has no opacities. `rate` is the
    /// position's learning rate now, as a factor of its first; `extent` the scene's. A Gaussian that is not finite is not moved.
    pub fn shifts<S: DensityScene>(&self, scene: &S, extent: f32, rate: f32, rng: &mut Rng) -> Option<Vec<f32>> {
        if !scene.has_opacity() {
            return None;
        }
        let scale = S::noise_factor(self.strength * rate * (self.every as f32).sqrt(), extent);
        let shifts = (0..scene.len()).flat_map(|index| {
            let gaussian = scene.shape(index);
            let weight = sigmoid(-STEEPNESS * (sigmoid(gaussian.opacity_logit()) - OPACITY));
            gaussian.diffusion(scale * weight, rng)
        });
        Some(shifts.collect())
    }

    /// Fails where a number is outside its range.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the offender.
    pub fn validate(&self) -> Result<(), Error> {
        if !(self.strength >= 0.0 && self.strength.is_finite()) {
            return Err(Error::setting("noise.strength", self.strength, "0 or more, and finite"));
        }
        if self.every == 0 { Err(Error::setting("noise.every", self.every, "at least 1")) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use glam::{Mat2, Mat3, Vec2, Vec3};
    use gs_core::{Gaussian2d, Gaussian3d, Scene, Scene2d, Scene3d, scene::logit};

    use super::*;

    fn gaussian(opacity: f32) -> Gaussian2d {
        Gaussian2d {
            mean: Vec2::splat(40.0),
            log_scale: Vec2::new(1.5, 0.2),
            rotation: 0.7,
            opacity_logit: logit(opacity),
            color: Vec3::ONE,
        }
    }

    #[test]
    fn the_transparent_move_as_their_covariance_says_and_the_opaque_stay() {
        let count = 20_000;
        let scene: Scene2d = (0..2 * count).map(|i| gaussian(if i < count { 0.005 } else { 0.5 })).collect();
        let noise = Noise { strength: 50.0, every: 4 };
        let shifts = noise.shifts(&scene, 200.0, 0.5, &mut Rng::new(3, 4)).unwrap();
        let (moved, still) = shifts.as_chunks::<2>().0.split_at(count);
        assert!(still.as_flattened().iter().all(|v| v.abs() < 1e-6));
        // Half of the strength at the threshold's opacity; in units of the noise's own covariance, whose root is Σ.
        let scale = 50.0 * 0.5 * 2.0 / 200.0 * 0.5;
        let whiten = (gaussian(0.5).covariance() * scale).inverse();
        let mut second = Mat2::ZERO;
        for &shift in moved {
            let z = whiten * Vec2::from_array(shift);
            second += Mat2::from_cols(z * z.x, z * z.y) * (1.0 / count as f32);
        }
        assert!(second.abs_diff_eq(Mat2::IDENTITY, 4.0 * (2.0 / count as f32).sqrt()), "{second}");
    }

    #[test]
    fn in_space_the_noise_has_all_three_axes_and_grows_with_the_extent() {
        let count = 20_000;
        let faint = Gaussian3d {
            mean: Vec3::ONE,
            log_scale: Vec3::new(-1.0, 0.3, 0.9),
            rotation: [0.9, 0.3, -0.2, 0.4],
            opacity_logit: logit(0.005),
            sh: vec![Vec3::ZERO],
        };
        let mut scene = Scene3d::default();
        (0..count).for_each(|_| scene.push(faint.clone()));
        let noise = Noise { strength: 3.0, every: 1 };
        let shifts = noise.shifts(&scene, 4.0, 0.5, &mut Rng::new(3, 4)).unwrap();
        let whiten = (faint.covariance().unwrap() * (3.0 * 0.5 * 4.0 * 0.5)).inverse();
        let mut second = Mat3::ZERO;
        for &shift in shifts.as_chunks::<3>().0 {
            let z = whiten * Vec3::from_array(shift);
            second += Mat3::from_cols(z * z.x, z * z.y, z * z.z) * (1.0 / count as f32);
        }
        assert!(second.abs_diff_eq(Mat3::IDENTITY, 4.0 * (2.0 / count as f32).sqrt()), "{second}");
    }

    #[test]
    fn nothing_moves_without_opacities_or_strength_and_what_is_broken_stays() {
        let opaque: Scene2d = [Gaussian2d { opacity_logit: f32::INFINITY, ..gaussian(0.5) }].into_iter().collect();
        assert_eq!(Noise::default().shifts(&opaque, 9.0, 1.0, &mut Rng::new(1, 1)), None);
        let broken = Gaussian2d { log_scale: Vec2::NAN, ..gaussian(0.01) };
        let scene: Scene2d = [broken].into_iter().collect();
        assert_eq!(Noise::default().shifts(&scene, 9.0, 1.0, &mut Rng::new(1, 1)), Some(vec![0.0; 2]));
        assert!(!Noise::NONE.is_due(1) && Noise { every: 3, ..Noise::default() }.is_due(6));
        assert!(Noise { every: 0, ..Noise::default() }.validate().is_err());
        assert!(Noise { strength: f32::NAN, ..Noise::default() }.validate().is_err());
    }
}
