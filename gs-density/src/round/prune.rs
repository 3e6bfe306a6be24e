//! Pruning of transparent, too large and not finite Gaussians.

use gs_core::{
    Error,
    constants::PRUNE_OPACITY,
    edit::{PruneCause, Removal},
    sigmoid,
};
use serde::{Deserialize, Serialize};

use super::size::SizeThreshold;
use crate::observation::{DensityGaussian, DensityScene, Observation};

gs_core::impl_with!(Prune);

/// Settings of pruning. Gaussians that are not finite are always pruned. *Source:* paper §2.2.3,
/// 3DGS.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
#[non_exhaustive]
pub struct Prune {
    /// Opacity ε_α below which Gaussians are pruned. 0..=1, default [`PRUNE_OPACITY`]; 0 prunes
    /// none. In a scene without opacities every Gaussian is opaque.
    pub opacity: f32,
    /// Size above which Gaussians are pruned. Default none: an image's background may need large
    /// ones.
    pub larger_than: Option<SizeThreshold>,
    /// Step, counted from 1, up to which no Gaussian is too large. Default 0; in 3DGS the step of
    /// the first opacity reset, before which all Gaussians may still be large.
    #[serde(skip_serializing_if = "is_zero")]
    pub larger_after: u32,
}

/// Settings files and the digests of settings leave out default values.
fn is_zero(step: &u32) -> bool {
    *step == 0
}

impl Default for Prune {
    fn default() -> Self {
        Self { opacity: PRUNE_OPACITY, larger_than: None, larger_after: 0 }
    }
}

impl Prune {
    /// Prunes only Gaussians that are not finite.
    pub(crate) const NOT_FINITE_ONLY: Self = Self { opacity: 0.0, larger_than: None, larger_after: 0 };

    /// Why a Gaussian is pruned after step `step`, counted from 1, if it is; the first of: not
    /// finite, transparent, too large.
    fn cause(&self, gaussian: &impl DensityGaussian, extent: f32, step: u32) -> Option<PruneCause> {
        let too_large =
            || step > self.larger_after && self.larger_than.is_some_and(|b| b.is_exceeded(gaussian, extent));
        if !gaussian.is_finite() {
            Some(PruneCause::NotFinite)
        } else if sigmoid(gaussian.opacity_logit()) < self.opacity {
            Some(PruneCause::Transparent)
        } else if too_large() {
            Some(PruneCause::TooLarge)
        } else {
            None
        }
    }

    /// All Gaussians of the observed scene that are pruned, in ascending order of their indices. A
    /// policy can change this list and begin a [`Round`](super::Round) with it.
    pub fn removals<S: DensityScene>(&self, observation: &Observation<'_, S>) -> Vec<Removal> {
        let Observation { scene, extent, step, .. } = *observation;
        let removal = |index: u32| {
            let cause = self.cause(&scene.gaussian(index as usize), extent, step.saturating_add(1))?;
            Some(Removal { index, cause })
        };
        (0..scene.len() as u32).filter_map(removal).collect()
    }

    /// Checks the ranges of all settings.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first value outside its range.
    pub(crate) fn validate(&self) -> Result<(), Error> {
        Error::within("prune.opacity", self.opacity, 0.0..=1.0, "0 to 1")?;
        self.larger_than.map_or(Ok(()), |bound| bound.validate("prune.larger-than"))
    }
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3};
    use gs_core::{Gaussian2d, Gaussian3d, logit};

    use super::*;

    const EXTENT: f32 = 100.0;

    fn gaussian() -> Gaussian2d {
        Gaussian2d {
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
        let cause = |g: Gaussian2d| prune.cause(&g, EXTENT, 1);
        assert_eq!(cause(gaussian()), None);
        assert_eq!(cause(Gaussian2d { opacity_logit: logit(0.006), ..gaussian() }), None);
        for opacity_logit in [logit(0.004), f32::NEG_INFINITY] {
            assert_eq!(cause(Gaussian2d { opacity_logit, ..gaussian() }), Some(PruneCause::Transparent));
        }
        let large = Gaussian2d { log_scale: Vec2::new(0.0, 51f32.ln()), ..gaussian() };
        assert_eq!(cause(large), Some(PruneCause::TooLarge));
        assert_eq!(Prune::default().cause(&large, EXTENT, 1), None);
        let later = Prune { larger_after: 3000, ..prune };
        assert_eq!(later.cause(&large, EXTENT, 3000), None);
        assert_eq!(later.cause(&large, EXTENT, 3001), Some(PruneCause::TooLarge));
    }

    #[test]
    fn prunes_nonfinite() {
        for bad in [
            Gaussian2d { mean: Vec2::new(f32::NAN, 0.0), ..gaussian() },
            Gaussian2d { log_scale: Vec2::new(0.0, f32::NEG_INFINITY), ..gaussian() },
            Gaussian2d { log_scale: Vec2::new(60.0, 0.0), ..gaussian() }, // its covariance overflows
            Gaussian2d { rotation: f32::INFINITY, ..gaussian() },
            Gaussian2d { opacity_logit: f32::NAN, ..gaussian() },
            Gaussian2d { color: Vec3::new(0.0, f32::NAN, 0.0), ..gaussian() },
        ] {
            assert_eq!(Prune::NOT_FINITE_ONLY.cause(&bad, EXTENT, 1), Some(PruneCause::NotFinite), "{bad:?}");
        }
        let vanishing = Gaussian2d { opacity_logit: f32::NEG_INFINITY, ..gaussian() };
        assert_eq!(Prune::NOT_FINITE_ONLY.cause(&vanishing, EXTENT, 1), None);
    }

    #[test]
    fn prunes_in_3d_too() {
        let good = Gaussian3d {
            mean: Vec3::ONE,
            log_scale: Vec3::splat(-3.0),
            rotation: [0.0, 2.0, 0.0, 0.0],
            opacity_logit: f32::INFINITY,
            sh: vec![Vec3::ONE; 4],
        };
        assert_eq!(Prune::NOT_FINITE_ONLY.cause(&good, 1.0, 1), None);
        let mut coefficient = good.clone();
        coefficient.sh[3].z = f32::NAN;
        for bad in [
            Gaussian3d { mean: Vec3::new(0.0, f32::INFINITY, 0.0), ..good.clone() },
            Gaussian3d { log_scale: Vec3::new(60.0, 0.0, 0.0), ..good.clone() }, // its covariance overflows
            Gaussian3d { rotation: [0.0; 4], ..good.clone() },                   // has no direction
            Gaussian3d { opacity_logit: f32::NAN, ..good.clone() },
            coefficient,
        ] {
            assert_eq!(Prune::NOT_FINITE_ONLY.cause(&bad, 1.0, 1), Some(PruneCause::NotFinite), "{bad:?}");
        }
        let prune = Prune { larger_than: Some(SizeThreshold::ExtentFraction(0.1)), ..Prune::default() };
        let large = Gaussian3d { log_scale: Vec3::new(-3.0, 0.6f32.ln(), -3.0), ..good };
        assert_eq!(prune.cause(&large, 5.0, 1), Some(PruneCause::TooLarge));
        assert_eq!(prune.cause(&large, 7.0, 1), None);
    }
}
