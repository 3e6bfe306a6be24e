//! Gaussians that a rendering leaves out at random, as a function of a seed and a Gaussian's index,
//! so that every backend leaves out the same ones.

use serde::{Deserialize, Serialize};

use crate::{error::Error, training::random_words};

crate::impl_with!(Dropout);

/// Leaves out a random share of the Gaussians and raises the opacity of the rest to compensate.
///
/// Each training step leaves out different Gaussians, so that no Gaussian relies on a few others in
/// front of it or behind it. This reduces overfitting where there are few views (*source:*
/// DropGaussian, Park et al., CVPR 2025). Opacities are multiplied by 1 / (1 − rate); α stays at
/// most [`Accuracy::alpha_max`](crate::Accuracy::alpha_max). For 3D scenes under
/// [`Blend::Over`](crate::Blend::Over).
///
/// A Gaussian is left out if ⌊r / 2⁸⌋ < rate · 2²⁴, where r is the first word of
/// [`random_words`](crate::math::random_words)`([seed, 0, index, 1])`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub struct Dropout {
    /// Share of the Gaussians that is left out, 0..=0.9. Default 0.
    pub rate: f32,
    /// Seed of the random numbers.
    pub seed: u32,
}

impl Dropout {
    /// Nothing is left out.
    pub const NONE: Self = Self { rate: 0.0, seed: 0 };

    /// Whether nothing is left out.
    pub fn is_none(&self) -> bool {
        self.rate == 0.0
    }

    /// rate · 2²⁴, rounded.
    pub fn threshold(&self) -> u32 {
        (f64::from(self.rate) * f64::from(1u32 << 24)).round() as u32
    }

    /// Whether Gaussian `index` is left out.
    #[inline]
    pub fn leaves_out(&self, index: u32) -> bool {
        let threshold = self.threshold();
        threshold > 0 && random_words([self.seed, 0, index, 1])[0] >> 8 < threshold
    }

    /// The factor by which the opacities of the remaining Gaussians are multiplied.
    pub fn gain(&self) -> f32 {
        1.0 / (1.0 - self.rate)
    }

    /// Checks the rate.
    ///
    /// # Errors
    /// [`Error::Setting`] where it is out of range.
    pub(crate) fn validate(&self) -> Result<(), Error> {
        Error::within("dropout", self.rate, 0.0..=0.9, "0 to 0.9")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_share_is_the_rate_and_changes_with_the_seed() {
        let count = 100_000;
        for rate in [0.0, 0.1, 0.5, 0.9] {
            let [first, second] = [3, 4].map(|seed| Dropout { rate, seed });
            first.validate().unwrap();
            let out = (0..count).filter(|&index| first.leaves_out(index)).count() as f32 / count as f32;
            assert!((out - rate).abs() < 0.005, "{out}, not {rate}");
            let both = (0..count).filter(|&index| first.leaves_out(index) && second.leaves_out(index)).count();
            assert!((both as f32 / count as f32 - rate * rate).abs() < 0.005, "{both}");
        }
        assert!(Dropout::NONE.is_none() && !Dropout { rate: 0.1, seed: 0 }.is_none());
        for rate in [-0.1, 0.95, f32::NAN] {
            assert!(Dropout { rate, seed: 0 }.validate().is_err());
        }
    }
}
