//! The initialiser that places Gaussians where the target needs them.

use gs_core::{Blend, Error, Gaussian2d, Image};
use gs_density::{
    Rng,
    seed::{Seeding, gradient_magnitude, mean_color},
};
use serde::{Deserialize, Serialize};

use crate::fit::init::{INITIAL_OPACITY, opacity_logit, positive, shared_color};

gs_core::impl_with!(Guided);

/// Smallest σ of a first Gaussian, px.
const MIN_SIGMA_PX: f32 = 0.7;

/// Largest σ of a first Gaussian, as a share of the image's longer side.
const MAX_SIGMA_SHARE: f32 = 0.25;

/// Placement by the magnitude of luminance's gradient: in strata along a Hilbert curve, spread by Lloyd steps, sized by the
/// density, stretched along edges, with the target's colours.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
#[non_exhaustive]
pub struct Guided {
    /// Share of the Gaussians that is spread uniformly, 0..=1; the others follow the image.
    pub uniform_fraction: f32,
    /// Passes of the (1, 2, 1)/4 kernel over the density before it is drawn from, at most 64: σ =
    /// √(passes/2) px.
    pub smoothing_passes: u32,
    /// Lloyd steps, at most 100; each takes about 1 ms for 700 Gaussians on 0.4 megapixels.
    pub lloyd_steps: u32,
    /// Largest average number of Gaussians per pixel; positive.
    pub max_per_pixel: f32,
    /// σ in units of the distance between Gaussians: σ = `sigma_factor` / √density; positive.
    pub sigma_factor: f32,
    /// Largest ratio of axes of a Gaussian on an edge, at least 1.
    pub max_aspect: f32,
    /// Opacity, above 0 and below 1.
    pub opacity: f32,
}

impl Default for Guided {
    fn default() -> Self {
        Self {
            uniform_fraction: 0.1,
            smoothing_passes: 2,
            lloyd_steps: 2,
            max_per_pixel: 0.3,
            sigma_factor: 0.5,
            max_aspect: 6.0,
            opacity: INITIAL_OPACITY,
        }
    }
}

impl Guided {
    pub(super) fn validate(&self) -> Result<(), Error> {
        Error::within("the initial uniform-fraction", self.uniform_fraction, 0.0..=1.0, "0 to 1")?;
        Error::within("the initial smoothing-passes", self.smoothing_passes, ..=64, "0 to 64")?;
        Error::within("the initial lloyd-steps", self.lloyd_steps, ..=100, "0 to 100")?;
        positive("the initial max-per-pixel", self.max_per_pixel)?;
        positive("the initial sigma-factor", self.sigma_factor)?;
        Error::within("the initial max-aspect", self.max_aspect, 1.0..=f32::MAX, "finite and at least 1")
    }

    pub(super) fn gaussians(&self, target: &Image, count: usize, blend: Blend, rng: &mut Rng) -> Vec<Gaussian2d> {
        let mut weights = gradient_magnitude(target);
        let (width, height) = target.size();
        weights.smooth(self.smoothing_passes);
        weights.mix_uniform(self.uniform_fraction);
        let seeding = Seeding {
            max_per_pixel: self.max_per_pixel,
            lloyd_steps: self.lloyd_steps,
            sigma_factor: self.sigma_factor,
            sigma_range_px: [MIN_SIGMA_PX, (width.max(height) as f32 * MAX_SIGMA_SHARE).max(MIN_SIGMA_PX)],
            max_aspect: self.max_aspect,
            opacity_logit: opacity_logit(blend, self.opacity),
        };
        seeding.gaussians(target, weights, count, rng, |mean, sigma, density| {
            shared_color(mean_color(target, mean, sigma), blend, sigma, density)
        })
    }
}
