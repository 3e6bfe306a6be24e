//! Which Gaussians go: transparent, too large, not finite.

use gs_core::{
    Error, PlanarGaussian, PlanarScene,
    constants::PRUNE_OPACITY,
    edit::{PruneCause, Removal},
    scene::sigmoid,
};
use serde::{Deserialize, Serialize};

use crate::size::SizeThreshold;

/// What is pruned. Gaussians that are not finite always are. *Source:* paper §2.2.3, 3DGS.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub struct Prune {
    /// Gaussians of less opacity go (ε_α). 0..=1, default [`PRUNE_OPACITY`]; 0 spares all. In a scene without opacities every
    /// Gaussian is opaque.
    pub opacity: f32,
    /// Gaussians whose larger scale exceeds this go. Default none: an image's background may need large ones.
    pub larger_than: Option<SizeThreshold>,
}

impl Default for Prune {
    fn default() -> Self {
        Self { opacity: PRUNE_OPACITY, larger_than: None }
    }
}

impl Prune {
    /// Spares all but the Gaussians that are not finite.
    pub const NOT_FINITE_ONLY: Self = Self { opacity: 0.0, larger_than: None };

    /// Why a Gaussian must go, if it must; the first of: not finite, transparent, too large. `size` is the image's, px.
    pub fn cause(&self, gaussian: &PlanarGaussian, size: (u32, u32)) -> Option<PruneCause> {
        if !is_finite(gaussian) {
            Some(PruneCause::NotFinite)
        } else if sigmoid(gaussian.opacity_logit) < self.opacity {
            Some(PruneCause::Transparent)
        } else if self.larger_than.is_some_and(|bound| bound.is_exceeded(gaussian, size)) {
            Some(PruneCause::TooLarge)
        } else {
            None
        }
    }

    /// All that must go, in order of their index.
    pub fn removals(&self, scene: &PlanarScene, size: (u32, u32)) -> Vec<Removal> {
        let doomed =
            |(index, gaussian)| self.cause(&gaussian, size).map(|cause| Removal { index: index as u32, cause });
        scene.iter().enumerate().filter_map(doomed).collect()
    }

    /// Fails where a number is outside its range.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the offender.
    pub fn validate(&self) -> Result<(), Error> {
        if !(0.0..=1.0).contains(&self.opacity) {
            return Err(Error::setting("prune.opacity", self.opacity, "0 to 1"));
        }
        self.larger_than.map_or(Ok(()), |bound| bound.validate("prune.larger-than"))
    }
}

/// Whether all parameters, and the covariance made of them, are finite. The opacity's logit may be ±∞: opaque, vanishing.
fn is_finite(gaussian: &PlanarGaussian) -> bool {
    gaussian.mean.is_finite()
        && gaussian.log_scale.is_finite()
        && gaussian.rotation.is_finite()
        && !gaussian.opacity_logit.is_nan()
        && gaussian.color.is_finite()
        && gaussian.covariance().is_finite()
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3};
    use gs_core::scene::logit;

    use super::*;

    const SIZE: (u32, u32) = (100, 50);

    fn gaussian() -> PlanarGaussian {
        PlanarGaussian {
            mean: Vec2::new(10.0, 20.0),
            log_scale: Vec2::new(1.0, 0.5),
            rotation: 0.3,
            opacity_logit: f32::INFINITY,
            color: Vec3::ONE,
        }
    }

    #[test]
    fn each_cause_is_found() {
        let prune = Prune { larger_than: Some(SizeThreshold::ExtentFraction(0.5)), ..Prune::default() };
        let cause = |g: PlanarGaussian| prune.cause(&g, SIZE);
        assert_eq!(cause(gaussian()), None);
        assert_eq!(cause(PlanarGaussian { opacity_logit: logit(0.006), ..gaussian() }), None);
        for opacity_logit in [logit(0.004), f32::NEG_INFINITY] {
            assert_eq!(cause(PlanarGaussian { opacity_logit, ..gaussian() }), Some(PruneCause::Transparent));
        }
        let large = PlanarGaussian { log_scale: Vec2::new(0.0, 51f32.ln()), ..gaussian() };
        assert_eq!(cause(large), Some(PruneCause::TooLarge));
        assert_eq!(Prune::default().cause(&large, SIZE), None);
    }

    #[test]
    fn whatever_is_not_finite_goes_even_where_nothing_else_does() {
        for bad in [
            PlanarGaussian { mean: Vec2::new(f32::NAN, 0.0), ..gaussian() },
            PlanarGaussian { log_scale: Vec2::new(0.0, f32::NEG_INFINITY), ..gaussian() },
            PlanarGaussian { log_scale: Vec2::new(60.0, 0.0), ..gaussian() }, // its covariance overflows
            PlanarGaussian { rotation: f32::INFINITY, ..gaussian() },
            PlanarGaussian { opacity_logit: f32::NAN, ..gaussian() },
            PlanarGaussian { color: Vec3::new(0.0, f32::NAN, 0.0), ..gaussian() },
        ] {
            assert_eq!(Prune::NOT_FINITE_ONLY.cause(&bad, SIZE), Some(PruneCause::NotFinite), "{bad:?}");
        }
        let vanishing = PlanarGaussian { opacity_logit: f32::NEG_INFINITY, ..gaussian() };
        assert_eq!(Prune::NOT_FINITE_ONLY.cause(&vanishing, SIZE), None);
    }
}
