//! Gaussians at given positions: their size, shape, direction and colour.

use glam::{Vec2, Vec3};
use gs_core::{Gaussian2d, Image};
use rayon::prelude::*;

use super::{DensityMap, HilbertOrder, Plane, Structure};
use crate::observation::Rng;

/// Radius of the largest square of pixels that a seed's colour is the mean of, px.
const MAX_COLOR_RADIUS_PX: f32 = 4.0;

/// Number and shape of seeds for their density.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seeding {
    /// Largest average number of seeds per pixel; positive.
    pub max_per_pixel: f32,
    /// Lloyd steps, which spread the positions further.
    pub lloyd_steps: u32,
    /// σ = `sigma_factor` / √density: in units of the distance between seeds. Positive.
    pub sigma_factor: f32,
    /// Smallest and largest σ (the geometric mean of both axes'), px.
    pub sigma_range_px: [f32; 2],
    /// Largest ratio of axes of a seed, at least 1; 1 makes all round.
    pub max_aspect: f32,
    /// Opacity logit; +∞ for scenes without opacities.
    pub opacity_logit: f32,
}

impl Seeding {
    /// `count` Gaussians for an image, with a density proportional to `weights`.
    ///
    /// `color(mean, σ, density)` is a Gaussian's colour at its mean (px), for its σ (px) and the
    /// density of Gaussians there (px⁻²).
    pub fn gaussians(
        &self,
        image: &Image,
        weights: Plane,
        count: usize,
        rng: &mut Rng,
        color: impl Fn(Vec2, f32, f32) -> Vec3 + Sync,
    ) -> Vec<Gaussian2d> {
        let (width, height) = image.size();
        let density = DensityMap::from_weights(weights, count, self.max_per_pixel);
        let mut positions = density.stratified(&HilbertOrder::shared(width, height), rng);
        density.relax(&mut positions, self.lloyd_steps);
        let color = |mean, sigma| color(mean, sigma, density.at(mean));
        seed_gaussians(&positions, &density, &Structure::new(image), self, color)
    }
}

/// ‖∇Y‖ of the luminance Y = (R + 2 G + B)/4 at every pixel of an image, px⁻¹.
pub fn gradient_magnitude(image: &Image) -> Plane {
    Structure::new(image).gradient_magnitude()
}

/// Creates a Gaussian at each position.
///
/// σ follows the density. The longer axis lies along the edge; the ratio of axes is the fourth root
/// of the ratio of the structure tensor's eigenvalues, at the area of a round Gaussian. `color(mean,
/// σ)` is the Gaussian's colour.
fn seed_gaussians(
    positions: &[Vec2],
    density: &DensityMap,
    structure: &Structure<'_>,
    shape: &Seeding,
    color: impl Fn(Vec2, f32) -> Vec3 + Sync,
) -> Vec<Gaussian2d> {
    let [smallest, largest] = shape.sigma_range_px;
    positions
        .par_iter()
        .with_min_len(256)
        .map(|&mean| {
            // A density of 0 gives +∞ and the largest σ.
            let sigma = (shape.sigma_factor / density.at(mean).sqrt()).min(largest).max(smallest);
            let orientation = structure.at(mean);
            let half_log_aspect = 0.5 * orientation.aspect.min(shape.max_aspect).max(1.0).ln();
            Gaussian2d {
                mean,
                log_scale: Vec2::new(half_log_aspect, -half_log_aspect) + sigma.ln(),
                rotation: orientation.angle,
                opacity_logit: shape.opacity_logit,
                color: color(mean, sigma),
            }
        })
        .collect()
}

/// Mean colour of the pixels of `image` within about σ of `mean` (at most 4 px), both px; of the
/// nearest pixel for small σ.
pub fn mean_color(image: &Image, mean: Vec2, sigma: f32) -> Vec3 {
    mean_around(image.size(), mean, sigma, |pixel| Vec3::from_array(image.pixels()[pixel]))
}

/// Mean of `value(row-major index)` over the pixels of [`mean_color`].
pub(crate) fn mean_around((width, height): (u32, u32), mean: Vec2, sigma: f32, value: impl Fn(usize) -> Vec3) -> Vec3 {
    let radius = sigma.min(MAX_COLOR_RADIUS_PX) as usize; // NaN becomes 0
    let (x, y) = ((mean.x as usize).min(width as usize - 1), (mean.y as usize).min(height as usize - 1));
    let (left, right) = (x.saturating_sub(radius), (x + radius).min(width as usize - 1));
    let (top, bottom) = (y.saturating_sub(radius), (y + radius).min(height as usize - 1));
    let mut sum = Vec3::ZERO;
    for y in top..=bottom {
        for x in left..=right {
            sum += value(y * width as usize + x);
        }
    }
    sum / ((right + 1 - left) * (bottom + 1 - top)) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHAPE: Seeding = Seeding {
        max_per_pixel: 1.0,
        lloyd_steps: 0,
        sigma_factor: 0.5,
        sigma_range_px: [0.7, 12.0],
        max_aspect: 3.0,
        opacity_logit: f32::INFINITY,
    };

    fn uniform(count: usize) -> DensityMap {
        DensityMap::from_weights(Plane::from_rows(40, 40, |_, row| row.fill(1.0)), count, 1.0)
    }

    #[test]
    fn seeds_are_stretched_along_an_edge_and_keep_their_area() {
        let image = Image::from_fn(40, 40, |x, _| [if x < 20 { 0.1 } else { 0.8 }; 3]).unwrap();
        let structure = Structure::new(&image);
        let places = [Vec2::new(20.0, 20.0), Vec2::new(5.0, 5.0)];
        let seeds = seed_gaussians(&places, &uniform(100), &structure, &SHAPE, |p, s| mean_color(&image, p, s));
        let [on_edge, on_flat] = [seeds[0], seeds[1]];
        let vertical = std::f32::consts::FRAC_PI_2;
        assert!((on_edge.rotation.abs() - vertical).abs() < 1e-3);
        assert!(((on_edge.log_scale.x - on_edge.log_scale.y).exp() - 3.0).abs() < 1e-3);
        assert_eq!(on_flat.log_scale.x, on_flat.log_scale.y);
        let sigma = 0.5 / (100.0f32 / 1600.0).sqrt();
        for seed in seeds {
            assert!((seed.log_scale.element_sum() * 0.5 - sigma.ln()).abs() < 1e-4);
        }
        assert!((on_flat.color - Vec3::splat(0.1)).abs().max_element() < 1e-6);
        assert!(on_edge.color.x > 0.2 && on_edge.color.x < 0.7);
    }

    #[test]
    fn sigma_stays_in_its_range() {
        let image = Image::filled(40, 40, [0.5; 3]).unwrap();
        let structure = Structure::new(&image);
        let sigma = |count| {
            let seeds = seed_gaussians(&[Vec2::ONE], &uniform(count), &structure, &SHAPE, |_, _| Vec3::ZERO);
            seeds[0].log_scale.x.exp()
        };
        assert!((sigma(1) - 12.0).abs() < 1e-4);
        assert!((sigma(1600) - 0.7).abs() < 1e-4);
    }
}
