//! Undistorts images: computes the picture of a pinhole camera by interpolation. Where a pixel of
//! a 360° image's face covers several of the image, it is the mean over points spread within it.

use glam::{DVec2, dvec2};
use gs_core::Camera;

use super::CompactImage;
use crate::{
    dataset::SourceCamera,
    image::{AnyPixels, Pixels, Sample, with_pixels},
};

/// The picture that the pinhole `camera` would have seen from the place of `source`.
pub(crate) fn undistorted(whole: &CompactImage, source: &SourceCamera, camera: &Camera) -> CompactImage {
    let mask = whole.mask.as_deref();
    let (pixels, mask) = with_pixels!(&whole.pixels, pixels => of_samples(pixels, mask, source, camera));
    CompactImage { pixels, mask }
}

fn of_samples<S: Sample>(
    pixels: &Pixels<S>,
    mask: Option<&[bool]>,
    source: &SourceCamera,
    camera: &Camera,
) -> (AnyPixels, Option<Vec<bool>>) {
    let Pixels { has_alpha, samples, .. } = pixels;
    let (samples, mask) = if *has_alpha {
        // Transparent pixels have arbitrary colours, which must not bleed into their neighbours.
        let premultiplied = |&[r, g, b, a]: &[S; 4]| {
            let opacity = (a.number() / S::WHITE).clamp(0.0, 1.0);
            [r.number() * opacity, g.number() * opacity, b.number() * opacity, opacity]
        };
        let straight = |[r, g, b, a]: [f32; 4]| {
            let color = if a > 1e-4 { [r / a, g / a, b / a] } else { [0.0; 3] };
            [color[0], color[1], color[2], a * S::WHITE].map(S::nearest)
        };
        Grid::new(samples.as_chunks().0, source, premultiplied).warp(source, camera, mask, straight)
    } else {
        let numbers = |pixel: &[S; 3]| pixel.map(S::number);
        Grid::new(samples.as_chunks().0, source, numbers).warp(source, camera, mask, |pixel| pixel.map(S::nearest))
    };
    (S::any(Pixels { width: camera.width, height: camera.height, has_alpha: *has_alpha, samples }), mask)
}

/// Pixels with interpolation.
struct Grid<'a, P, F> {
    pixels: &'a [P],
    /// The numbers of a pixel.
    numbers: F,
    width: u32,
    height: u32,
    /// Whether the left and right borders continue each other.
    closed: bool,
}

/// Largest number of points along each side of a pixel.
const MOST_SAMPLES: f64 = 8.0;

/// Points along each side of a pixel of a face that are at most a pixel of the 360° image apart:
/// the pixel's angle, divided by those of the image, which shrink towards the poles.
fn samples(ray: DVec2, seen: Option<DVec2>, focal: DVec2, source: &SourceCamera) -> u32 {
    let Some(seen) = seen else { return 1 };
    let angle = 1.0 / (focal.min_element() * (1.0 + ray.length_squared()).sqrt());
    let latitude = (seen.y - source.center.y) / source.focal.y;
    let pixels = angle * source.focal.max_element() / latitude.cos().max(1e-6);
    pixels.ceil().clamp(1.0, MOST_SAMPLES) as u32
}

impl<'a, S: Sample, const N: usize, F: Fn(&[S; N]) -> [f32; N]> Grid<'a, [S; N], F> {
    fn new(pixels: &'a [[S; N]], source: &SourceCamera, numbers: F) -> Self {
        Self { pixels, numbers, width: source.width, height: source.height, closed: source.is_panorama() }
    }

    /// The samples of the pinhole picture, row-major, made by `stored`, 0 where there are none, and a
    /// mask if not all are valid.
    fn warp(
        &self,
        source: &SourceCamera,
        camera: &Camera,
        mask: Option<&[bool]>,
        stored: impl Fn([f32; N]) -> [S; N],
    ) -> (Vec<S>, Option<Vec<bool>>) {
        let (focal, center) = (camera.focal.as_dvec2(), camera.center.as_dvec2());
        let size = dvec2(f64::from(self.width), f64::from(self.height));
        let width = camera.width as usize;
        let count = width * camera.height as usize;
        let (mut warped, mut counts) = (vec![S::default(); N * count], vec![false; count]);
        let pixels = warped.as_chunks_mut::<N>().0;
        let rows = pixels.chunks_mut(width.max(1)).zip(counts.chunks_mut(width.max(1))).enumerate();
        for (y, (pixels, counts)) in rows {
            for (x, (pixel, is_valid)) in pixels.iter_mut().zip(counts).enumerate() {
                let ray = |within: DVec2| (dvec2(x as f64, y as f64) + within - center) / focal;
                let place = |within: DVec2| {
                    source.to_pixel(ray(within)).filter(|p| p.cmpge(DVec2::ZERO).all() && p.cmple(size).all())
                };
                let seen = place(DVec2::splat(0.5));
                let samples = if self.closed { samples(ray(DVec2::splat(0.5)), seen, focal, source) } else { 1 };
                *pixel = stored(match samples {
                    1 => seen.map_or([0.0; N], |place| self.between(place)),
                    _ => self.mean(samples, place),
                });
                *is_valid = seen.is_some_and(|place| mask.is_none_or(|mask| mask[self.nearest(place)]));
            }
        }
        let all = mask.is_none() && counts.iter().all(|counts| *counts);
        (warped, (!all).then_some(counts))
    }

    /// The pixel at a position inside the frame.
    fn nearest(&self, place: DVec2) -> usize {
        let (x, y) = ((place.x as u32).min(self.width - 1), (place.y as u32).min(self.height - 1));
        y as usize * self.width as usize + x as usize
    }

    /// The mean over `samples` × `samples` points of a pixel; `place` gives their positions in the
    /// image for positions from 0 to 1 within the pixel.
    fn mean(&self, samples: u32, place: impl Fn(DVec2) -> Option<DVec2>) -> [f32; N] {
        let within = |i: u32| (f64::from(i) + 0.5) / f64::from(samples);
        let points = (0..samples).flat_map(|y| (0..samples).map(move |x| dvec2(within(x), within(y))));
        let (mut sum, mut count) = ([0.0; N], 0.0);
        for value in points.filter_map(place).map(|place| self.between(place)) {
            sum.iter_mut().zip(value).for_each(|(sum, value)| *sum += value);
            count += 1.0;
        }
        if count > 0.0 { sum.map(|sum| sum / count) } else { sum }
    }

    /// Interpolates at a position inside the frame with Catmull-Rom's cubic over 4×4 pixels,
    /// clamped to their range, because a cubic overshoots at edges.
    fn between(&self, place: DVec2) -> [f32; N] {
        let corner = (place - 0.5).floor();
        let fraction = place - 0.5 - corner;
        let width = i64::from(self.width);
        let column = |k: i64| match (self.closed, corner.x as i64 + k) {
            (true, x) => x.rem_euclid(width) as usize,
            (false, x) => x.clamp(0, width - 1) as usize,
        };
        let row = |k: i64| (corner.y as i64 + k).clamp(0, i64::from(self.height) - 1) as usize;
        let columns = [column(-1), column(0), column(1), column(2)];
        // Each column is summed first: these 4·N independent sums fit SIMD registers.
        let (mut sums, mut lows, mut highs) = ([[0.0; N]; 4], [[f32::INFINITY; N]; 4], [[f32::NEG_INFINITY; N]; 4]);
        for (k, weight) in (-1..).zip(catmull_rom(fraction.y as f32)) {
            let line = &self.pixels[row(k) * self.width as usize..];
            for (j, &x) in columns.iter().enumerate() {
                let values = (self.numbers)(&line[x]);
                for (c, value) in values.into_iter().enumerate() {
                    sums[j][c] += weight * value;
                    lows[j][c] = if value < lows[j][c] { value } else { lows[j][c] };
                    highs[j][c] = if value > highs[j][c] { value } else { highs[j][c] };
                }
            }
        }
        let weights = catmull_rom(fraction.x as f32);
        std::array::from_fn(|c| {
            let sum = (0..4).map(|j| weights[j] * sums[j][c]).sum::<f32>();
            let low = lows.iter().fold(f32::INFINITY, |low, column| low.min(column[c]));
            let high = highs.iter().fold(f32::NEG_INFINITY, |high, column| high.max(column[c]));
            sum.max(low).min(high)
        })
    }
}

/// Weights of the values at −1, 0, 1, 2 for a position `t` between 0 and 1 (Catmull and Rom 1974;
/// Keys 1981 with a = −½).
fn catmull_rom(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [0.5 * (-t3 + 2.0 * t2 - t), 0.5 * (3.0 * t3 - 5.0 * t2 + 2.0), 0.5 * (-3.0 * t3 + 4.0 * t2 + t), 0.5 * (t3 - t2)]
}
