//! Direction and strength of an image's edges: the structure tensor, evaluated at single places.

use glam::Vec2;
use gs_core::Image;

use super::Plane;

/// Half the side of the window that gradients are gathered in, px.
const WINDOW_RADIUS: usize = 3;
const WINDOW: usize = 2 * WINDOW_RADIUS + 1;
/// The window, and one pixel more all around for the central differences at its rim.
const PATCH: usize = WINDOW + 2;

/// exp(−x²/2σ²) for σ = 1.5 px, one axis of the window.
const WINDOW_WEIGHTS: [f32; WINDOW] = [0.135_335, 0.411_112, 0.800_737, 1.0, 0.800_737, 0.411_112, 0.135_335];

/// Variance of the gradient that counts as no edge: 1/255 per px, the step of an 8-bit image.
const NOISE: f32 = 1.0 / (255.0 * 255.0);

/// Structure tensors of an image's luminance, (R + 2 G + B)/4. Border pixels are repeated outside
/// the image.
///
/// A tensor costs the work of some hundred pixels. There are far fewer seeds than pixels, so
/// tensors are computed per seed.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Structure<'a> {
    image: &'a Image,
}

/// Direction of the edge through a place, and the shape of a Gaussian there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct EdgeOrientation {
    /// Direction along the edge, rad, from +x towards +y, in (−π/2, π/2].
    pub(crate) angle: f32,
    /// Best ratio of axes for a Gaussian there, at least 1: the fourth root of the ratio of the
    /// tensor's eigenvalues.
    ///
    /// The eigenvalues are squared gradients. Curvatures across and along the edge have the ratio
    /// of the gradients, and a piecewise approximation has the least error where its elements'
    /// extents are proportional to one over the square root of the curvatures.
    pub(crate) aspect: f32,
}

impl<'a> Structure<'a> {
    /// The structure of an image.
    pub(crate) fn new(image: &'a Image) -> Self {
        Self { image }
    }

    /// The edge at a place of the image, px; outside it, at the nearest pixel.
    pub(crate) fn at(&self, place: Vec2) -> EdgeOrientation {
        let [xx, xy, yy] = self.tensor(place);
        let (mean, half_difference) = (0.5 * (xx + yy), 0.5 * (xx - yy));
        let spread = half_difference.hypot(xy);
        let ratio = (mean + spread + NOISE) / ((mean - spread).max(0.0) + NOISE);
        // The gradient's direction is ½ atan2(2 xy, xx − yy); the edge is perpendicular to it.
        let angle = 0.5 * (-xy).atan2(-half_difference);
        EdgeOrientation { angle, aspect: if ratio > 1.0 { ratio.sqrt().sqrt() } else { 1.0 } }
    }

    /// Weighted mean of ∇Y ∇Yᵀ around a place: (xx, xy, yy), px⁻².
    fn tensor(&self, place: Vec2) -> [f32; 3] {
        let patch = self.luminance_around(place);
        let [mut xx, mut xy, mut yy] = [0.0f32; 3];
        for j in 0..WINDOW {
            let (above, here, below) = (&patch[j][1..], &patch[j + 1], &patch[j + 2][1..]);
            let [mut row_xx, mut row_xy, mut row_yy] = [0.0f32; 3];
            for i in 0..WINDOW {
                let gx = 0.5 * (here[i + 2] - here[i]);
                let gy = 0.5 * (below[i] - above[i]);
                row_xx += WINDOW_WEIGHTS[i] * gx * gx;
                row_xy += WINDOW_WEIGHTS[i] * gx * gy;
                row_yy += WINDOW_WEIGHTS[i] * gy * gy;
            }
            xx += WINDOW_WEIGHTS[j] * row_xx;
            xy += WINDOW_WEIGHTS[j] * row_xy;
            yy += WINDOW_WEIGHTS[j] * row_yy;
        }
        let total: f32 = WINDOW_WEIGHTS.iter().sum();
        [xx, xy, yy].map(|v| v / (total * total))
    }

    /// Luminance around the pixel of a place.
    fn luminance_around(&self, place: Vec2) -> [[f32; PATCH]; PATCH] {
        let (width, height) = self.image.size();
        // `as` takes negative numbers and NaN to 0.
        let (x, y) = ((place.x as u32).min(width - 1), (place.y as u32).min(height - 1));
        let nth = |middle: u32, k: usize, side: u32| (middle + k as u32).saturating_sub(PATCH as u32 / 2).min(side - 1);
        let columns: [usize; PATCH] = std::array::from_fn(|i| nth(x, i, width) as usize);
        std::array::from_fn(|j| {
            let row = self.image.row(nth(y, j, height));
            columns.map(|column| luminance(row[column]))
        })
    }

    /// ‖∇Y‖ of every pixel, px⁻¹.
    pub(crate) fn gradient_magnitude(&self) -> Plane {
        let (width, height) = self.image.size();
        let row_of = |y: usize| self.image.row((y as u32).min(height - 1)).iter().map(|&pixel| luminance(pixel));
        Plane::from_rows(width, height, |y, row| {
            let line = self.image.row(y as u32);
            let (first, last) = (&line[..1], &line[line.len() - 1..]);
            let here: Vec<f32> = first.iter().chain(line).chain(last).map(|&pixel| luminance(pixel)).collect();
            let differences =
                row_of(y + 1).zip(row_of(y.saturating_sub(1))).map(|(below, above)| 0.5 * (below - above));
            for ((out, here), gy) in row.iter_mut().zip(here.windows(3)).zip(differences) {
                let gx = 0.5 * (here[2] - here[0]);
                *out = (gx * gx + gy * gy).sqrt();
            }
        })
    }
}

fn luminance([r, g, b]: [f32; 3]) -> f32 {
    0.25 * (r + b) + 0.5 * g
}

#[cfg(test)]
mod tests {
    use std::f32::consts::{FRAC_PI_2, PI};

    use super::*;

    /// A soft edge through the middle whose normal points to `angle`.
    fn edge(angle: f32) -> Image {
        let (sin, cos) = angle.sin_cos();
        let image = Image::from_fn(33, 33, |x, y| {
            let across = (x as f32 - 16.0) * cos + (y as f32 - 16.0) * sin;
            [1.0 / (1.0 + (-across).exp()); 3]
        });
        image.unwrap()
    }

    #[test]
    fn orientation_runs_along_an_edge() {
        for normal in [0.0f32, 0.4, 0.8, 1.3, -0.6, FRAC_PI_2] {
            let found = Structure::new(&edge(normal)).at(Vec2::splat(16.5));
            let off = (found.angle - (normal + FRAC_PI_2)).rem_euclid(PI);
            assert!(off.min(PI - off) < 0.03, "normal {normal}: found {}", found.angle);
            assert!(found.aspect > 3.0, "normal {normal}: aspect {}", found.aspect);
        }
    }

    #[test]
    fn flat_and_round_places_have_no_orientation() {
        let flat = Image::filled(5, 4, [0.3, 0.9, 0.1]).unwrap();
        assert_eq!(Structure::new(&flat).at(Vec2::new(2.0, 2.0)).aspect, 1.0);
        let blob = Image::from_fn(33, 33, |x, y| {
            [(-(((x as f32 - 16.0).powi(2) + (y as f32 - 16.0).powi(2)) / 8.0)).exp(); 3]
        });
        assert!(Structure::new(&blob.unwrap()).at(Vec2::splat(16.5)).aspect < 1.1);
    }

    #[test]
    fn every_position_of_any_image_has_a_structure() {
        for (w, h) in [(1, 1), (1, 9), (8, 2)] {
            let image = Image::from_fn(w, h, |x, y| [x as f32, y as f32, 0.5]).unwrap();
            let structure = Structure::new(&image);
            assert_eq!(structure.gradient_magnitude().size(), (w, h));
            for place in [Vec2::ZERO, Vec2::new(w as f32, h as f32), Vec2::splat(-9.0), Vec2::splat(1e9), Vec2::NAN] {
                let found = structure.at(place);
                assert!(found.angle.is_finite() && found.aspect.is_finite(), "{w}x{h} at {place}");
            }
        }
    }

    #[test]
    fn the_gradient_is_that_of_a_ramp() {
        let image = Image::from_fn(9, 7, |x, y| [0.03 * x as f32 + 0.04 * y as f32; 3]).unwrap();
        let gradient = Structure::new(&image).gradient_magnitude();
        assert!((gradient.values()[3 * 9 + 4] - 0.05).abs() < 1e-6);
    }
}
