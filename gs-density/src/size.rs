//! Sizes that divide small Gaussians from large ones, in pixels or relative to the image.

use gs_core::{Error, PlanarGaussian};
use serde::{Deserialize, Serialize};

/// A bound on the larger of a Gaussian's two scales (its standard deviation along the long axis).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SizeThreshold {
    /// A fraction of the image's longer side, positive. It takes the place of the scene's extent, of which 3DGS has
    /// `percent_dense` = 0.01.
    ExtentFraction(f32),
    /// px, positive.
    Pixels(f32),
}

impl SizeThreshold {
    /// The bound in px for an image of `size` (columns, rows).
    pub fn pixels(self, size: (u32, u32)) -> f32 {
        match self {
            Self::ExtentFraction(fraction) => fraction * size.0.max(size.1) as f32,
            Self::Pixels(pixels) => pixels,
        }
    }

    /// Whether a Gaussian's larger scale exceeds the bound.
    pub fn is_exceeded(self, gaussian: &PlanarGaussian, size: (u32, u32)) -> bool {
        gaussian.log_scale.max_element().exp() > self.pixels(size)
    }

    /// Fails where the bound is not positive.
    pub(crate) fn validate(self, what: &'static str) -> Result<(), Error> {
        let (Self::ExtentFraction(value) | Self::Pixels(value)) = self;
        if value > 0.0 { Ok(()) } else { Err(Error::setting(what, value, "positive")) }
    }
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3};

    use super::*;

    #[test]
    fn the_longer_side_and_the_larger_scale_count() {
        let gaussian = PlanarGaussian {
            mean: Vec2::ZERO,
            log_scale: Vec2::new(0.0, 2f32.ln()),
            rotation: 0.0,
            opacity_logit: 0.0,
            color: Vec3::ONE,
        };
        assert_eq!(SizeThreshold::ExtentFraction(0.01).pixels((50, 300)), 3.0);
        assert!(SizeThreshold::ExtentFraction(0.01).is_exceeded(&gaussian, (100, 190)));
        assert!(!SizeThreshold::ExtentFraction(0.01).is_exceeded(&gaussian, (100, 210)));
        assert!(SizeThreshold::Pixels(1.9).is_exceeded(&gaussian, (1, 1)));
        assert!(SizeThreshold::Pixels(f32::NAN).validate("split-above").is_err());
    }
}
