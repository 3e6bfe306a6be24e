//! Initialisers that use at most the target's colours: at random, or along the border.

use glam::{Vec2, Vec3};
use gs_core::{Blend, Gaussian2d, Image};
use gs_density::{Rng, seed::mean_color};
use rand::RngExt as _;
use serde::{Deserialize, Serialize};

use crate::fit::init::{INITIAL_OPACITY, opacity_logit, round, shared_color};

gs_core::impl_with!(Random, Periphery);

/// Colours of the first Gaussians.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Colors {
    /// Uniform in 0..1.
    #[default]
    Random,
    /// Colours of the target around the mean.
    Target,
}

/// Round Gaussians of one size, uniformly anywhere in the image (*source:* paper §3.4).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
#[non_exhaustive]
pub struct Random {
    /// σ, px; positive. With the paper's 15 px each reaches the target from anywhere in an image of
    /// 128 px.
    pub scale_px: f32,
    /// Colours.
    pub colors: Colors,
    /// Opacity, above 0 and below 1.
    pub opacity: f32,
}

impl Default for Random {
    fn default() -> Self {
        Self { scale_px: 15.0, colors: Colors::Random, opacity: INITIAL_OPACITY }
    }
}

/// Round Gaussians of one size along the border pixels of the image, evenly, with nothing inside
/// (*source:* paper Fig. 9).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
#[non_exhaustive]
pub struct Periphery {
    /// σ, px; positive. Small, so that none reaches the middle of the image.
    pub scale_px: f32,
    /// Colours.
    pub colors: Colors,
    /// Opacity, above 0 and below 1.
    pub opacity: f32,
}

impl Default for Periphery {
    fn default() -> Self {
        Self { scale_px: 2.0, colors: Colors::Random, opacity: INITIAL_OPACITY }
    }
}

impl Random {
    pub(super) fn gaussians(&self, target: &Image, count: usize, blend: Blend, rng: &mut Rng) -> Vec<Gaussian2d> {
        let size = Vec2::new(target.width() as f32, target.height() as f32);
        let per_px2 = count as f32 / size.element_product();
        let logit = opacity_logit(blend, self.opacity);
        (0..count)
            .map(|_| {
                let mean = Vec2::new(rng.random(), rng.random()) * size;
                let color = self.colors.at(target, mean, self.scale_px, rng);
                round(mean, self.scale_px, logit, shared_color(color, blend, self.scale_px, per_px2))
            })
            .collect()
    }
}

impl Periphery {
    pub(super) fn gaussians(&self, target: &Image, count: usize, blend: Blend, rng: &mut Rng) -> Vec<Gaussian2d> {
        // The rectangle through the centres of the border pixels, walked clockwise from its
        // top-left corner.
        let (width, height) = (target.width() as f32 - 1.0, target.height() as f32 - 1.0);
        let perimeter = 2.0 * (width + height);
        let on_border = |along: f32| match along {
            a if a < width => Vec2::new(a, 0.0),
            a if a < width + height => Vec2::new(width, a - width),
            a if a < 2.0 * width + height => Vec2::new(2.0 * width + height - a, height),
            a => Vec2::new(0.0, (perimeter - a).max(0.0)),
        };
        // A line of Gaussians covers the pixels on it √(2π) σ · (Gaussians per px) times; as if
        // spread over its own breadth.
        let breadth = self.scale_px * std::f32::consts::TAU.sqrt();
        let per_px2 = count as f32 / (perimeter.max(1.0) * breadth);
        let logit = opacity_logit(blend, self.opacity);
        (0..count)
            .map(|i| {
                let jitter: f32 = rng.random();
                let mean = on_border((i as f32 + jitter) / count as f32 * perimeter) + 0.5;
                let color = self.colors.at(target, mean, self.scale_px, rng);
                round(mean, self.scale_px, logit, shared_color(color, blend, self.scale_px, per_px2))
            })
            .collect()
    }
}

impl Colors {
    fn at(self, target: &Image, mean: Vec2, sigma: f32, rng: &mut Rng) -> Vec3 {
        match self {
            Self::Random => Vec3::new(rng.random(), rng.random(), rng.random()),
            Self::Target => mean_color(target, mean, sigma),
        }
    }
}
