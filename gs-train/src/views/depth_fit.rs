//! The meaning of a depth map's values: its scale and shift, fitted to known depths.

use glam::{Vec2, Vec3};
use gs_core::Camera;
use gs_density::Rng;
use gs_io::dataset::DepthMap;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;

/// Least number of known points in a view that agree with its map.
const LEAST_AGREEING: f32 = 10.0;

/// Least share of the known points in a view that agree with its map.
const LEAST_SHARE: f32 = 0.3;

/// Largest difference of ln-depth at which a map agrees with a known point.
const SAME_POINT: f32 = 0.05;

/// Largest variance of the difference of ln-depth between a map and the known points that agree
/// with it, as a share of the variance of the ln-depth of these points.
const MOST_UNEXPLAINED: f64 = 0.25;

/// Number of random pairs of known points from which scale and shift of a map are computed.
const TRIALS: u32 = 400;

/// Steps of least squares over the points that agree.
const REFINEMENTS: u32 = 4;

/// A map's value at a pixel, and the true depth there.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sample {
    pub(crate) value: f32,
    pub(crate) depth: f32,
}

/// The values of a map and the depths of the known positions in sight. Of each square of `cell` px of
/// the camera's image, only the nearest position is used, because positions behind a surface are not
/// on the map. `values` are those of the camera's pixels, row-major, 0 where unknown.
pub(crate) fn samples(camera: &Camera, values: &[f32], cell: u32, known: impl Iterator<Item = Vec3>) -> Vec<Sample> {
    let (width, height) = (camera.width, camera.height);
    let columns = width.div_ceil(cell);
    let mut nearest: Vec<Option<Sample>> = vec![None; (columns * height.div_ceil(cell)) as usize];
    for position in known {
        let Some((at, depth)) = camera.project(position) else { continue };
        if !(at.cmpge(Vec2::ZERO).all() && at.x < width as f32 && at.y < height as f32) {
            continue;
        }
        let (x, y) = (at.x as u32, at.y as u32);
        let value = values[(y * width + x) as usize];
        let place = &mut nearest[(y / cell * columns + x / cell) as usize];
        if value > 0.0 && place.is_none_or(|other| depth < other.depth) {
            *place = Some(Sample { value, depth });
        }
    }
    nearest.into_iter().flatten().collect()
}

/// The values of a map at the pixels of a camera with the same pose and axis, row-major; 0 where
/// unknown.
pub(crate) fn values_at(map: &DepthMap, camera: &Camera) -> Vec<f32> {
    let scale = map.camera.focal / camera.focal;
    let value = |x: u32, y: u32| {
        let at = (Vec2::new(x as f32, y as f32) + 0.5 - camera.center) * scale + map.camera.center;
        let inside = at.cmpge(Vec2::ZERO).all() && at.x < map.camera.width as f32 && at.y < map.camera.height as f32;
        if inside { map.values[at.y as usize * map.camera.width as usize + at.x as usize] } else { 0.0 }
    };
    (0..camera.height).flat_map(|y| (0..camera.width).map(move |x| (x, y))).map(|(x, y)| value(x, y)).collect()
}

/// What the values of a map mean.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Meaning {
    Depth,
    InverseDepth,
}

/// Depths from the values of a map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Fit {
    meaning: Meaning,
    scale: f32,
    shift: f32,
}

impl Fit {
    /// Depths with this many world units for a value of 1.
    pub(crate) fn in_units(scale: f32) -> Self {
        Self { meaning: Meaning::Depth, scale, shift: 0.0 }
    }

    /// The depth for a value of the map; `None` where the value is 0 or gives no positive, finite
    /// depth.
    pub(crate) fn known_depth(self, value: f32) -> Option<f32> {
        let depth = (value > 0.0).then(|| self.depth(value))?;
        (depth > 0.0 && depth.is_finite()).then_some(depth)
    }

    fn depth(self, value: f32) -> f32 {
        let line = self.scale * value + self.shift;
        match self.meaning {
            Meaning::Depth => line,
            Meaning::InverseDepth => 1.0 / line,
        }
    }

    /// ln-depth of the fit minus the true ln-depth; NaN if the fit's depth is negative.
    fn difference(self, sample: &Sample) -> f32 {
        (self.depth(sample.value) / sample.depth).ln()
    }

    /// How well a sample agrees: 1 for an exact match, 0 for a difference of [`SAME_POINT`] or
    /// more.
    fn agreement(self, sample: &Sample) -> f32 {
        let share = self.difference(sample) / SAME_POINT;
        // `max` also turns NaN into 0.
        (1.0 - share * share).max(0.0)
    }

    /// Whether the depths of the agreeing samples vary much more than their differences from the
    /// fit. Without this check, any map would fit a surface at about one depth.
    fn explains(self, samples: &[Sample]) -> bool {
        let agreeing = || samples.iter().filter(|sample| self.agreement(sample) > 0.0);
        let variance = |of: &dyn Fn(&Sample) -> f32| {
            let (count, sum, squares) = agreeing().map(of).fold((0.0f32, 0.0f64, 0.0f64), |(n, s, q), value| {
                let value = f64::from(value);
                (n + 1.0, s + value, q + value * value)
            });
            let count = f64::from(count);
            squares / count - (sum / count) * (sum / count)
        };
        variance(&|sample| self.difference(sample)) <= MOST_UNEXPLAINED * variance(&|sample| sample.depth.ln())
    }

    /// The line through two samples; `None` unless it rises.
    fn through(meaning: Meaning, a: Sample, b: Sample) -> Option<Self> {
        let [p, q] = [a, b].map(|sample| match meaning {
            Meaning::Depth => sample.depth,
            Meaning::InverseDepth => 1.0 / sample.depth,
        });
        let scale = (p - q) / (a.value - b.value);
        (scale > 0.0 && scale.is_finite()).then_some(Self { meaning, scale, shift: p - scale * a.value })
    }

    /// The fit with the least squared relative differences from these samples.
    fn least_squares<'s>(meaning: Meaning, samples: impl Iterator<Item = &'s Sample>) -> Option<Self> {
        // (s·v + t)/y = 1 for each sample, with y the depth or its inverse.
        let (mut aa, mut ab, mut bb, mut a, mut b) = (0.0f64, 0.0f64, 0.0f64, 0.0f64, 0.0f64);
        for sample in samples {
            let weight = match meaning {
                Meaning::Depth => 1.0 / f64::from(sample.depth),
                Meaning::InverseDepth => f64::from(sample.depth),
            };
            let value = f64::from(sample.value) * weight;
            aa += value * value;
            ab += value * weight;
            bb += weight * weight;
            a += value;
            b += weight;
        }
        let determinant = aa * bb - ab * ab;
        let (scale, shift) = ((a * bb - b * ab) / determinant, (aa * b - ab * a) / determinant);
        (scale > 0.0 && scale.is_finite()).then_some(Self { meaning, scale: scale as f32, shift: shift as f32 })
    }

    /// The fit with which the samples agree best, and the sum of their agreement. Random pairs are
    /// tried first (RANSAC; Fischler and Bolles 1981; with the score of Torr and Zisserman 2000),
    /// then least squares over the samples that agree.
    fn best(meaning: Meaning, samples: &[Sample]) -> Option<(Self, f32)> {
        let mut rng = Rng::seed_from_u64(samples.len() as u64);
        let mut pick = || samples[rng.random_range(0..samples.len())];
        let mut best: Option<(Self, f32)> = None;
        let keep = |best: &mut Option<(Self, f32)>, fit: Self| {
            let score = samples.iter().map(|sample| fit.agreement(sample)).sum::<f32>();
            if best.is_none_or(|(_, highest)| score > highest) {
                *best = Some((fit, score));
            }
        };
        for _ in 0..TRIALS {
            if let Some(fit) = Self::through(meaning, pick(), pick()) {
                keep(&mut best, fit);
            }
        }
        for _ in 0..REFINEMENTS {
            let (fit, _) = best?;
            let agreeing = samples.iter().filter(|sample| fit.agreement(sample) > 0.0);
            if let Some(refined) = Self::least_squares(meaning, agreeing) {
                keep(&mut best, refined);
            }
        }
        best
    }
}

/// The fit of each map to its samples; `None` where no fit explains them. All maps are read as depths
/// or all as inverse depths, whichever agrees better with the samples.
pub(crate) fn fits(samples: &[Vec<Sample>]) -> Vec<Option<Fit>> {
    let fit = |meaning: Meaning, samples: &[Sample]| {
        let enough = |score: f32| score >= LEAST_AGREEING && score >= LEAST_SHARE * samples.len() as f32;
        let (fit, score) = if enough(samples.len() as f32) { Fit::best(meaning, samples)? } else { return None };
        (enough(score) && fit.explains(samples)).then_some((fit, score))
    };
    let fits = |meaning: Meaning| -> Vec<_> { samples.par_iter().map(|samples| fit(meaning, samples)).collect() };
    let score = |fits: &[Option<(Fit, f32)>]| fits.iter().flatten().map(|(_, score)| score).sum::<f32>();
    let (depth, inverse) = (fits(Meaning::Depth), fits(Meaning::InverseDepth));
    let fits = if score(&depth) >= score(&inverse) { depth } else { inverse };
    fits.into_iter().map(|found| Some(found?.0)).collect()
}
