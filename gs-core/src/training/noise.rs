//! Noise on the means between training steps, as a function of a seed, a step and a Gaussian's
//! index, so that every backend adds the same up to rounding.

use glam::{Mat2, Mat3, Vec2, Vec3};

use crate::{
    constants::{NOISE_OPACITY, NOISE_STEEPNESS},
    error::Error,
    scene::sigmoid,
};

/// Noise on the means, by which faint Gaussians explore.
///
/// Each mean moves by `scale` · s(−100 (o − 0.005)) · Σ η, with s the logistic function, o the
/// opacity, Σ the covariance and η standard normal (*source:* 3DGS-MCMC, Kheradmand et al. 2024). A
/// Gaussian whose shift is not finite does not move.
///
/// η is a function of `seed`, `step` and the Gaussian's index: four random words `r` =
/// [`random_words`]`([seed, step, index, 0])` become uniform numbers u = (⌊r / 2⁸⌋ + 1) / 2²⁴, and
/// those, by the method of Box and Muller, √(−2 ln u₀) cos 2π u₁, √(−2 ln u₀) sin 2π u₁ and √(−2 ln
/// u₂) cos 2π u₃.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeanNoise {
    /// Factor of Σ η. Unit: 1/px in 2D scenes, 1/world unit in 3D scenes.
    pub scale: f32,
    /// Seed of the random numbers.
    pub seed: u32,
    /// Step, which selects the random numbers of the seed.
    pub step: u32,
    /// Number of Gaussians, the first of the scene, that do not move.
    pub fixed: u32,
}

impl MeanNoise {
    /// Checks the scale.
    ///
    /// # Errors
    /// [`Error::Setting`] where it is not finite.
    pub fn validate(&self) -> Result<(), Error> {
        Error::within("the scale of the noise", self.scale, f32::MIN..=f32::MAX, "finite")
    }

    /// η of Gaussian `index`; 2D scenes use the first two components.
    #[inline]
    pub(crate) fn normals(&self, index: u32) -> Vec3 {
        let [a, b, c, d] = random_words([self.seed, self.step, index, 0]).map(uniform);
        let (sin, cos) = (std::f32::consts::TAU * b).sin_cos();
        let (radius, other) = ((-2.0 * a.ln()).sqrt(), (-2.0 * c.ln()).sqrt());
        Vec3::new(radius * cos, radius * sin, other * (std::f32::consts::TAU * d).cos())
    }

    /// Shift of the mean of Gaussian `index` in a 2D scene, px, where Σ = L Lᵀ.
    #[inline]
    pub fn shift_2d(&self, index: u32, l: Mat2, opacity_logit: f32) -> Vec2 {
        let shift = l * (l.transpose() * self.normals(index).truncate()) * self.weight(opacity_logit);
        if shift.is_finite() { shift } else { Vec2::ZERO }
    }

    /// Shift of the mean of Gaussian `index` in a 3D scene, world units, where Σ = M Mᵀ.
    #[inline]
    pub fn shift_3d(&self, index: u32, m: Mat3, opacity_logit: f32) -> Vec3 {
        let shift = m * (m.transpose() * self.normals(index)) * self.weight(opacity_logit);
        if shift.is_finite() { shift } else { Vec3::ZERO }
    }

    fn weight(&self, opacity_logit: f32) -> f32 {
        self.scale * sigmoid(-NOISE_STEEPNESS * (sigmoid(opacity_logit) - NOISE_OPACITY))
    }
}

/// Four random words from four counters: the hash `pcg4d` of Jarzynski and Olano, *Hash functions
/// for GPU rendering*, 2020. The last counter tells uses apart: 0 for noise on means, 1 for dropout, 2
/// for the seeds of dropout.
#[inline]
pub fn random_words(counter: [u32; 4]) -> [u32; 4] {
    let mut v = counter.map(|word| word.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    let mix = |v: &mut [u32; 4]| {
        for (to, [a, b]) in [(0, [1, 3]), (1, [2, 0]), (2, [0, 1]), (3, [1, 2])] {
            v[to] = v[to].wrapping_add(v[a].wrapping_mul(v[b]));
        }
    };
    mix(&mut v);
    v = v.map(|word| word ^ (word >> 16));
    mix(&mut v);
    v
}

/// A uniform number in (0, 1]; exact.
fn uniform(word: u32) -> f32 {
    ((word >> 8) + 1) as f32 / 16_777_216.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::logit;

    #[test]
    fn normals_have_mean_0_and_variance_1_and_do_not_correlate() {
        let count = 100_000;
        let noise = |seed, step| MeanNoise { scale: 1.0, seed, step, fixed: 0 };
        for noise in [noise(0, 0), noise(7, 30_000)] {
            let next = MeanNoise { step: noise.step + 1, ..noise };
            let (mut mean, mut second, mut with_next) = (Vec3::ZERO, Mat3::ZERO, Vec3::ZERO);
            for index in 0..count {
                let normals = noise.normals(index);
                mean += normals / count as f32;
                second += Mat3::from_cols(normals * normals.x, normals * normals.y, normals * normals.z)
                    * (1.0 / count as f32);
                with_next += normals * next.normals(index) / count as f32;
            }
            let within = 4.0 * (2.0 / count as f32).sqrt();
            assert!(mean.abs().max_element() < within, "{mean}");
            assert!(second.abs_diff_eq(Mat3::IDENTITY, within), "{second}");
            assert!(with_next.abs().max_element() < within, "{with_next}");
        }
    }

    #[test]
    fn transparent_gaussians_move_by_their_covariance_and_opaque_ones_stay() {
        let count = 20_000;
        let l = Mat2::from_cols(Vec2::new(3.4, 2.9), Vec2::new(-0.8, 0.9));
        // Half of the strength at the threshold's opacity; in units of the noise's own covariance,
        // whose root is Σ.
        let noise = MeanNoise { scale: 0.25, seed: 3, step: 4, fixed: 0 };
        let whiten = (l * l.transpose() * 0.125).inverse();
        let mut second = Mat2::ZERO;
        for index in 0..count {
            let z = whiten * noise.shift_2d(index, l, logit(0.005));
            second += Mat2::from_cols(z * z.x, z * z.y) * (1.0 / count as f32);
            assert!(noise.shift_2d(index, l, logit(0.5)).length() < 1e-6);
            assert!(noise.shift_2d(index, l, f32::INFINITY).length() < 1e-6);
        }
        assert!(second.abs_diff_eq(Mat2::IDENTITY, 4.0 * (2.0 / count as f32).sqrt()), "{second}");
    }

    #[test]
    fn in_3d_the_noise_has_all_three_axes() {
        let count = 20_000;
        let m = Mat3::from_cols(Vec3::new(0.4, 0.1, 0.0), Vec3::new(-0.3, 1.2, 0.2), Vec3::new(0.1, -0.5, 2.0));
        let noise = MeanNoise { scale: 3.0, seed: 3, step: 4, fixed: 0 };
        let whiten = (m * m.transpose() * 1.5).inverse();
        let mut second = Mat3::ZERO;
        for index in 0..count {
            let z = whiten * noise.shift_3d(index, m, logit(0.005));
            second += Mat3::from_cols(z * z.x, z * z.y, z * z.z) * (1.0 / count as f32);
        }
        assert!(second.abs_diff_eq(Mat3::IDENTITY, 4.0 * (2.0 / count as f32).sqrt()), "{second}");
    }

    #[test]
    fn broken_gaussians_stay() {
        let noise = MeanNoise { scale: 1.0, seed: 1, step: 1, fixed: 0 };
        assert_eq!(noise.shift_2d(0, Mat2::NAN, logit(0.001)), Vec2::ZERO);
        assert_eq!(noise.shift_3d(0, Mat3::IDENTITY, f32::NAN), Vec3::ZERO);
        noise.validate().unwrap();
        assert!(MeanNoise { scale: f32::NAN, ..noise }.validate().is_err());
    }
}
