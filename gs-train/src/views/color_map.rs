//! Affine maps of colours, and their fit to pairs of colours.

use glam::{DMat3, DVec3};
use gs_core::Image;
use serde::{Deserialize, Serialize};

/// An affine map of colours: c ↦ A c + b.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(from = "[[f64; 4]; 3]", into = "[[f64; 4]; 3]")]
pub(crate) struct ColorMap {
    linear: DMat3,
    offset: DVec3,
}

/// A colour, and the colour that a map should give for it.
pub(crate) type ColorPair = ([f32; 3], [f32; 3]);

/// Largest absolute value in the linear part of a usable map and of its inverse: three stops.
const MOST_GAIN: f64 = 8.0;

/// Distance of colours at which a pair has half the weight in a robust fit.
const OUTLYING: f64 = 0.1;

/// Rounds of a robust fit.
const ROUNDS: usize = 5;

/// Prior of a robust fit, in units of the variance that the map leaves. Errors of neighbouring
/// pixels are correlated, so thousands of pixels have no more information than a few dozen
/// independent ones. On 112 photographs of a room, a prior of 0.03 ends 0.2 dB higher than one of
/// 0.005, at a variance of about 0.006.
const PRIOR_PER_VARIANCE: f64 = 4.0;

/// Least prior of a robust fit: a standard deviation of six levels of 255.
const LEAST_PRIOR: f64 = 5e-4;

impl ColorMap {
    pub(crate) const IDENTITY: Self = Self { linear: DMat3::IDENTITY, offset: DVec3::ZERO };

    /// The mapped colour.
    pub(crate) fn apply(&self, color: [f32; 3]) -> [f32; 3] {
        self.of(vector(color)).as_vec3().to_array()
    }

    fn of(&self, color: DVec3) -> DVec3 {
        self.linear * color + self.offset
    }

    /// The image with this map applied to its colours, not clamped.
    pub(crate) fn image(&self, image: &Image) -> Image {
        let mut image = image.clone();
        image.pixels_mut().iter_mut().for_each(|pixel| *pixel = self.apply(*pixel));
        image
    }

    /// Whether all numbers are finite.
    pub(crate) fn is_finite(&self) -> bool {
        self.linear.is_finite() && self.offset.is_finite()
    }

    /// Sum of squared distances between the mapped first colours and the second ones.
    pub(crate) fn squared_error(&self, pairs: &[ColorPair]) -> f64 {
        pairs.iter().map(|&(from, to)| (self.of(vector(from)) - vector(to)).length_squared()).sum()
    }

    /// The inverse of this map; `None` if either of the two exceeds [`MOST_GAIN`].
    pub(crate) fn inverse(&self) -> Option<Self> {
        let linear = self.linear.inverse();
        let possible = |matrix: &DMat3| matrix.to_cols_array().iter().all(|value| value.abs() <= MOST_GAIN);
        (possible(&self.linear) && possible(&linear)).then(|| Self { linear, offset: -(linear * self.offset) })
    }

    /// The map that first applies `first`, then this one.
    pub(crate) fn after(&self, first: &Self) -> Self {
        Self { linear: self.linear * first.linear, offset: self.of(first.offset) }
    }

    /// The mean of maps; not finite without any.
    pub(crate) fn mean(maps: &[Self]) -> Self {
        let share = 1.0 / maps.len() as f64;
        let sum = maps.iter().fold((DMat3::ZERO, DVec3::ZERO), |sum, map| (sum.0 + map.linear, sum.1 + map.offset));
        Self { linear: sum.0 * share, offset: sum.1 * share }
    }

    /// The map that takes the first colour of each pair closest to the second, by least squares.
    ///
    /// `prior` is a variance of colours. Along directions of the colour space in which the colours
    /// vary much less, the linear part stays close to the identity.
    pub(crate) fn fit(pairs: &[ColorPair], prior: f64) -> Self {
        Self::weighted(pairs, prior, |_, _| 1.0)
    }

    /// A robust [`Self::fit`]: a few rounds with Cauchy weights, so that pairs that the map leaves
    /// far apart count less. The prior is a multiple of the variance that the map leaves, so that
    /// it is stronger the worse the colours agree.
    pub(crate) fn robust_fit(pairs: &[ColorPair]) -> Self {
        (0..ROUNDS).fold(Self::IDENTITY, |map, _| {
            let weight = |from: DVec3, to: DVec3| 1.0 / (1.0 + (map.of(from) - to).length_squared() / OUTLYING.powi(2));
            let (mut total, mut squared) = (0.0, 0.0);
            for &(from, to) in pairs {
                let (from, to) = (vector(from), vector(to));
                total += weight(from, to);
                squared += weight(from, to) * (map.of(from) - to).length_squared() / 3.0;
            }
            let left = if total > 0.0 { squared / total } else { 0.0 };
            Self::weighted(pairs, LEAST_PRIOR.max(PRIOR_PER_VARIANCE * left), weight)
        })
    }

    /// With the covariances C of first colours x and second colours y, the linear part is
    /// (C_yx + prior) (C_xx + prior)⁻¹; the offset takes one mean to the other.
    fn weighted(pairs: &[ColorPair], prior: f64, weight: impl Fn(DVec3, DVec3) -> f64) -> Self {
        let pairs = || pairs.iter().map(|&(from, to)| (vector(from), vector(to)));
        let (mut total, mut mean_from, mut mean_to) = (0.0, DVec3::ZERO, DVec3::ZERO);
        for (from, to) in pairs() {
            let weight = weight(from, to);
            total += weight;
            mean_from += weight * from;
            mean_to += weight * to;
        }
        if !(total > 0.0) {
            return Self::IDENTITY;
        }
        (mean_from, mean_to) = (mean_from / total, mean_to / total);
        let prior = DMat3::from_diagonal(DVec3::splat(prior));
        let (mut of_from, mut of_both) = (prior, prior);
        for (from, to) in pairs() {
            let weight = weight(from, to) / total;
            let (from, to) = (from - mean_from, to - mean_to);
            of_from += outer(weight * from, from);
            of_both += outer(weight * to, from);
        }
        let linear = of_both * of_from.inverse();
        Self { linear, offset: mean_to - linear * mean_from }
    }
}

/// a bᵀ.
fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

fn vector(color: [f32; 3]) -> DVec3 {
    DVec3::from_array(color.map(f64::from))
}

impl From<[[f64; 4]; 3]> for ColorMap {
    /// The map with these rows: three factors and an offset each.
    fn from(rows: [[f64; 4]; 3]) -> Self {
        let column = |k: usize| DVec3::from_array(rows.map(|row| row[k]));
        Self { linear: DMat3::from_cols(column(0), column(1), column(2)), offset: column(3) }
    }
}

impl From<ColorMap> for [[f64; 4]; 3] {
    fn from(map: ColorMap) -> Self {
        std::array::from_fn(|k| {
            let row = map.linear.row(k);
            [row.x, row.y, row.z, map.offset[k]]
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KNOWN: [[f64; 4]; 3] = [[0.6, 0.05, 0.0, 0.02], [0.1, 0.8, -0.05, -0.03], [0.0, 0.1, 1.2, 0.05]];

    /// Random colours, and the same colours after a map.
    fn pairs(map: ColorMap) -> Vec<ColorPair> {
        let scattered = |i: u32, k: u32| ((i * 3 + k).wrapping_mul(0x9e37_79b9) >> 8) as f32 / (1 << 24) as f32;
        let color = |i| [0, 1, 2].map(|k| scattered(i, k));
        (0..300).map(|i| (color(i), map.apply(color(i)))).collect()
    }

    fn difference(a: ColorMap, b: ColorMap) -> f64 {
        let (a, b): ([[f64; 4]; 3], [[f64; 4]; 3]) = (a.into(), b.into());
        a.as_flattened().iter().zip(b.as_flattened()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn a_known_map_is_found_and_undone() {
        let known = ColorMap::from(KNOWN);
        assert!(difference(ColorMap::fit(&pairs(known), 0.0), known) < 1e-5);
        let there_and_back = known.inverse().unwrap().after(&known);
        assert!(difference(there_and_back, ColorMap::IDENTITY) < 1e-12, "{there_and_back:?}");
        assert_eq!(<[[f64; 4]; 3]>::from(known), KNOWN);
        let other = ColorMap::from([[1.4, -0.05, 0.0, 0.0], [-0.1, 1.2, 0.05, 0.1], [0.0, -0.1, 0.8, 0.0]]);
        let mean = ColorMap::mean(&[known, other]);
        assert!((mean.linear.x_axis - DVec3::new(1.0, 0.0, 0.0)).length() < 1e-12);
        assert!((mean.offset.y - 0.035).abs() < 1e-12);
    }

    #[test]
    fn a_robust_fit_is_not_led_astray() {
        let known = ColorMap::from(KNOWN);
        let mut pairs = pairs(known);
        pairs.iter_mut().step_by(7).for_each(|pair| pair.1 = [1.0, 0.0, 1.0]);
        let (plain, robust) = (ColorMap::fit(&pairs, 0.0), ColorMap::robust_fit(&pairs));
        assert!(difference(plain, known) > 0.1, "{plain:?}");
        assert!(difference(robust, known) < 0.05, "{robust:?}");
    }

    #[test]
    fn colours_that_do_not_vary_say_little() {
        // Greys of one image, greys of half the brightness in the other.
        let greys: Vec<_> = (0..50).map(|i| ([i as f32 / 50.0; 3], [i as f32 / 100.0; 3])).collect();
        let map = ColorMap::fit(&greys, 1e-3);
        let grey = map.apply([0.8; 3]);
        assert!(grey.iter().all(|value| (value - 0.4).abs() < 5e-3), "{grey:?}");
        let tint = DVec3::new(1.0, -1.0, 0.0);
        assert!((map.linear * tint - tint).length() < 1e-9, "{map:?}");
        // A single colour is taken to the other.
        let single = ColorMap::fit(&[([0.5; 3], [0.25, 0.5, 0.75])], 1e-3);
        assert_eq!(single.apply([0.5; 3]), [0.25, 0.5, 0.75]);
        assert_eq!(ColorMap::fit(&[], 1e-3), ColorMap::IDENTITY);
    }

    #[test]
    fn a_map_that_no_camera_makes_has_no_inverse() {
        let scaled = |by: f64| ColorMap { linear: DMat3::IDENTITY * by, offset: DVec3::ZERO };
        assert!(scaled(0.2).inverse().is_some() && scaled(5.0).inverse().is_some());
        for by in [0.0, 0.1, 10.0, f64::NAN] {
            assert_eq!(scaled(by).inverse(), None, "{by}");
        }
    }
}
