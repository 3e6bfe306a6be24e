//! Thresholds on sizes of Gaussians, absolute or relative to the scene.

use gs_core::Error;
use serde::{Deserialize, Serialize};

use crate::observation::DensityGaussian;

/// Threshold on a Gaussian's largest scale (its standard deviation along the longest axis).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub enum SizeThreshold {
    /// Fraction of the scene's extent ([`Observation::extent`](crate::Observation::extent)),
    /// positive. `percent_dense` of 3DGS is 0.01.
    ExtentFraction(f32),
    /// Size in px, positive. 2D scenes.
    Pixels(f32),
    /// Size in world units, positive. 3D scenes.
    WorldUnits(f32),
}

impl SizeThreshold {
    /// The threshold in a scene of this extent, in the scene's unit.
    pub(crate) fn bound(self, extent: f32) -> f32 {
        match self {
            Self::ExtentFraction(fraction) => fraction * extent,
            Self::Pixels(bound) | Self::WorldUnits(bound) => bound,
        }
    }

    /// Whether a Gaussian's largest scale exceeds the threshold.
    pub(crate) fn is_exceeded(self, gaussian: &impl DensityGaussian, extent: f32) -> bool {
        gaussian.largest_scale() > self.bound(extent)
    }

    /// Checks that the threshold is positive.
    pub(crate) fn validate(self, what: &'static str) -> Result<(), Error> {
        let (Self::ExtentFraction(value) | Self::Pixels(value) | Self::WorldUnits(value)) = self;
        Error::within(what, value, f32::MIN_POSITIVE.., "positive")
    }
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3};
    use gs_core::{Gaussian2d, Gaussian3d};

    use super::*;

    #[test]
    fn the_largest_scale_counts() {
        let gaussian = Gaussian2d {
            mean: Vec2::ZERO,
            log_scale: Vec2::new(0.0, 2f32.ln()),
            rotation: 0.0,
            opacity_logit: 0.0,
            color: Vec3::ONE,
        };
        assert_eq!(SizeThreshold::ExtentFraction(0.01).bound(300.0), 3.0);
        assert!(SizeThreshold::ExtentFraction(0.01).is_exceeded(&gaussian, 190.0));
        assert!(!SizeThreshold::ExtentFraction(0.01).is_exceeded(&gaussian, 210.0));
        assert!(SizeThreshold::Pixels(1.9).is_exceeded(&gaussian, 1.0));
        let in_space = Gaussian3d {
            mean: Vec3::ZERO,
            log_scale: Vec3::new(0.0, -1.0, 2f32.ln()),
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit: 0.0,
            sh: Vec::new(),
        };
        assert!(SizeThreshold::WorldUnits(1.9).is_exceeded(&in_space, 1.0));
        assert!(!SizeThreshold::WorldUnits(2.1).is_exceeded(&in_space, 1.0));
        assert!(SizeThreshold::Pixels(f32::NAN).validate("split-above").is_err());
    }
}
