//! How much memory a training takes at its peak, estimated before it begins, bytes.
//!
//! Estimates are of the host's memory where gs-cpu computes; a GPU has memory of its own, which they do not count. They are made of the sizes of
//! arrays, and are a little too high rather than too low: tests hold them against what runs take.

use gs_core::{Blend, Loss, RenderSettings, Scene3d, effects::Statistics};
use gs_density::DensityPolicy;

use crate::{settings::FitSettings, train::TrainSettings};

/// Three `f32`: a pixel of an image, or of what is as large.
const IMAGE: u64 = 12;

/// One `f32` for each pixel.
const PLANE: u64 = 4;

/// Code, threads, tables.
const BASE: u64 = 60_000_000;

/// Of a picture that is drawn in parts, a part.
const PART: u64 = 32 << 20;

/// What the allocator keeps at most of what is freed: larger pieces than 32 MiB go back to the system.
const MOST_KEPT: u64 = 80_000_000;

/// A pair of a Gaussian and a tile that it touches: in the lists, and what it receives.
const ENTRY: u64 = 64;

/// A 2D Gaussian: parameters, moments, gradient, what is projected, and the copies on the host that a round of growth needs.
const PLANAR_GAUSSIAN: u64 = 700;

/// A 3D Gaussian of degree 0, with the entries that it usually has.
const SPATIAL_GAUSSIAN: u64 = 750;

/// Another number of a 3D Gaussian: with its moments and gradient, and the copies that a round of growth needs.
const SPATIAL_NUMBER: u64 = 24;

/// What drawing an image of this size takes, the image included.
pub fn drawing((width, height): (u32, u32)) -> u64 {
    let image = pixels(width, height) * IMAGE;
    BASE + image + image.min(PART)
}

/// What reading an image of this size takes at most, the image included.
pub fn reading((width, height): (u32, u32)) -> u64 {
    pixels(width, height) * (2 * IMAGE + PLANE)
}

/// What training on images of so many pixels takes whatever else it needs.
fn overhead(pixels: u64) -> u64 {
    BASE + (pixels * IMAGE).min(PART) + (4 * pixels * IMAGE).min(MOST_KEPT)
}

impl FitSettings {
    /// What a fit to an image of this size takes, the image and its results included.
    pub fn peak_bytes(&self, (width, height): (u32, u32)) -> u64 {
        let pixels = pixels(width, height);
        let target = 2 * IMAGE + of_target(self.loss);
        let policy: &dyn DensityPolicy = &self.policy;
        let step = of_step(&self.render, self.loss, policy.statistics());
        // A policy sees the rendering, weights of all pixels, and their order; what is shown or written is a rendering.
        let residual = if policy.needs_residual() { 2 * PLANE } else { 0 };
        overhead(pixels) + pixels * (target + step + IMAGE + residual) + self.of_gaussians(pixels)
    }

    /// What all Gaussians take. They stand as close as the image lets them: so many tiles, which are 16 columns broad, does each reach.
    fn of_gaussians(&self, pixels: u64) -> u64 {
        let count = u64::from(self.gaussians);
        let apart = (pixels as f64 / count.max(1) as f64).sqrt();
        let tiles = 2 + (3.0 * apart / 16.0) as u64;
        count * (PLANAR_GAUSSIAN + tiles * ENTRY)
    }
}

impl TrainSettings {
    /// What a training of so many Gaussians from views of these sizes takes, of whose pictures at most `keep_bytes` are kept.
    pub fn peak_bytes(&self, views: impl IntoIterator<Item = (u32, u32)>, keep_bytes: u64, gaussians: u64) -> u64 {
        let (mut all, mut largest) = (0, 0);
        for (width, height) in views {
            all += pixels(width, height);
            largest = largest.max(pixels(width, height));
        }
        // What is kept is counted without what D-SSIM adds to it.
        let kept = all.min(keep_bytes / IMAGE) * (IMAGE + of_target(self.loss));
        let policy: &dyn DensityPolicy<Scene3d> = &self.policy;
        let step = of_step(&self.render, self.loss, policy.statistics());
        // A photograph on its way to the backend, and a rendering.
        let passing = 3 * IMAGE + of_target(self.loss) + step;
        let numbers = 3 * ((u64::from(self.render.effects.sh_degree) + 1).pow(2) - 1);
        overhead(largest) + kept + largest * passing + gaussians * (SPATIAL_GAUSSIAN + numbers * SPATIAL_NUMBER)
    }
}

/// Bytes a pixel that a loss adds to each target.
fn of_target(loss: Loss) -> u64 {
    match loss {
        Loss::L1 | Loss::L2 => 0,
        Loss::L1Dssim { .. } => 3 * IMAGE,
    }
}

/// Bytes a pixel of a training step: the image, its gradient, the transmittance and the errors of pixels; nothing where tiles are done with
/// one by one.
fn of_step(render: &RenderSettings, loss: Loss, statistics: Statistics) -> u64 {
    let over = render.effects.blend == Blend::Over;
    if !over && loss == Loss::L2 && statistics == Statistics::None {
        return 0;
    }
    let transmittance = if over { PLANE } else { 0 };
    let errors = if statistics == Statistics::PixelError { PLANE } else { 0 };
    2 * IMAGE + transmittance + errors
}

/// Pixels as they lie in strips of 16 columns.
fn pixels(width: u32, height: u32) -> u64 {
    u64::from(width.next_multiple_of(16)) * u64::from(height)
}
