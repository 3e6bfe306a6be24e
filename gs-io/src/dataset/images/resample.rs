//! Undistorts images: computes the picture of a pinhole camera by interpolation. Where a pixel of
//! a 360° image's face covers several of the image, it is the mean over points spread within it.

use glam::{DVec2, Vec4, dvec2, vec4};
use gs_core::Camera;

use super::{CompactImage, Window};
use crate::{
    dataset::SourceCamera,
    image::{AnyPixels, Pixels, Sample, with_pixels},
};

/// A window of the picture that the pinhole `camera` would have seen from the place of `source`.
pub(super) fn undistorted(
    whole: &CompactImage,
    source: &SourceCamera,
    camera: &Camera,
    window: Window,
) -> CompactImage {
    let mask = whole.mask.as_deref();
    let (pixels, mask) = with_pixels!(&whole.pixels, pixels => of_samples(pixels, mask, source, (camera, window)));
    CompactImage { pixels, mask }
}

fn of_samples<S: Sample>(
    pixels: &Pixels<S>,
    mask: Option<&[bool]>,
    source: &SourceCamera,
    to: (&Camera, Window),
) -> (AnyPixels, Option<Vec<bool>>) {
    let Pixels { has_alpha, samples, .. } = pixels;
    let (samples, mask) = if *has_alpha {
        // Transparent pixels have arbitrary colours, which must not bleed into their neighbours.
        let premultiplied = |[r, g, b, a]: &[S; 4]| {
            let opacity = (a.number() / S::WHITE).clamp(0.0, 1.0);
            vec4(r.number() * opacity, g.number() * opacity, b.number() * opacity, opacity)
        };
        let straight = |pixel: Vec4| {
            let color = if pixel.w > 1e-4 { pixel / pixel.w } else { Vec4::ZERO };
            [S::nearest(color.x), S::nearest(color.y), S::nearest(color.z), S::nearest(pixel.w * S::WHITE)]
        };
        Grid::new(samples.as_chunks().0, source, premultiplied).warp(source, to, mask, straight)
    } else {
        let numbers = |[r, g, b]: &[S; 3]| vec4(r.number(), g.number(), b.number(), 0.0);
        let stored = |pixel: Vec4| [S::nearest(pixel.x), S::nearest(pixel.y), S::nearest(pixel.z)];
        Grid::new(samples.as_chunks().0, source, numbers).warp(source, to, mask, stored)
    };
    let Window { width, height, .. } = to.1;
    (S::any(Pixels { width, height, has_alpha: *has_alpha, samples }), mask)
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

impl<'a, S: Sample, const N: usize, F: Fn(&[S; N]) -> Vec4> Grid<'a, [S; N], F> {
    fn new(pixels: &'a [[S; N]], source: &SourceCamera, numbers: F) -> Self {
        Self { pixels, numbers, width: source.width, height: source.height, closed: source.is_panorama() }
    }

    /// The samples of the pinhole picture, row-major, made by `stored`, 0 where there are none, and a
    /// mask if not all are valid.
    fn warp(
        &self,
        source: &SourceCamera,
        (camera, window): (&Camera, Window),
        mask: Option<&[bool]>,
        stored: impl Fn(Vec4) -> [S; N],
    ) -> (Vec<S>, Option<Vec<bool>>) {
        let (focal, center) = (camera.focal.as_dvec2(), camera.center.as_dvec2());
        let size = dvec2(f64::from(self.width), f64::from(self.height));
        let corner = dvec2(f64::from(window.left), f64::from(window.top));
        let width = window.width as usize;
        let count = width * window.height as usize;
        let (mut warped, mut counts) = (vec![S::default(); N * count], vec![false; count]);
        let pixels = warped.as_chunks_mut::<N>().0;
        let rows = pixels.chunks_mut(width.max(1)).zip(counts.chunks_mut(width.max(1))).enumerate();
        for (y, (pixels, counts)) in rows {
            for (x, (pixel, is_valid)) in pixels.iter_mut().zip(counts).enumerate() {
                let ray = |within: DVec2| (dvec2(x as f64, y as f64) + corner + within - center) / focal;
                let place = |within: DVec2| {
                    source.to_pixel(ray(within)).filter(|p| p.cmpge(DVec2::ZERO).all() && p.cmple(size).all())
                };
                let seen = place(DVec2::splat(0.5));
                let samples = if self.closed { samples(ray(DVec2::splat(0.5)), seen, focal, source) } else { 1 };
                *pixel = stored(match samples {
                    1 => seen.map_or(Vec4::ZERO, |place| self.between(place)),
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
    fn mean(&self, samples: u32, place: impl Fn(DVec2) -> Option<DVec2>) -> Vec4 {
        let within = |i: u32| (f64::from(i) + 0.5) / f64::from(samples);
        let points = (0..samples).flat_map(|y| (0..samples).map(move |x| dvec2(within(x), within(y))));
        let (mut sum, mut count) = (Vec4::ZERO, 0.0);
        for value in points.filter_map(place).map(|place| self.between(place)) {
            sum += value;
            count += 1.0;
        }
        if count > 0.0 { sum / count } else { sum }
    }

    /// Interpolates at a position inside the frame with Catmull-Rom's cubic over 4×4 pixels,
    /// clamped to their range, because a cubic overshoots at edges.
    fn between(&self, place: DVec2) -> Vec4 {
        let corner = (place - 0.5).floor();
        let fraction = place - 0.5 - corner;
        let width = i64::from(self.width);
        let column = |k: i64| match (self.closed, corner.x as i64 + k) {
            (true, x) => x.rem_euclid(width) as usize,
            (false, x) => x.clamp(0, width - 1) as usize,
        };
        let row = |k: i64| (corner.y as i64 + k).clamp(0, i64::from(self.height) - 1) as usize;
        let rows = [row(-1), row(0), row(1), row(2)];
        let (of_columns, of_rows) = (catmull_rom(fraction.x as f32), catmull_rom(fraction.y as f32));
        let (mut sum, mut low, mut high) = (Vec4::ZERO, Vec4::INFINITY, Vec4::NEG_INFINITY);
        for (x, weight) in [column(-1), column(0), column(1), column(2)].into_iter().zip(of_columns) {
            let mut of_column = Vec4::ZERO;
            for (y, weight) in rows.into_iter().zip(of_rows) {
                let value = (self.numbers)(&self.pixels[y * self.width as usize + x]);
                of_column += weight * value;
                low = low.min(value);
                high = high.max(value);
            }
            sum += weight * of_column;
        }
        sum.max(low).min(high)
    }
}

/// Weights of the values at −1, 0, 1, 2 for a position `t` between 0 and 1 (Catmull and Rom 1974;
/// Keys 1981 with a = −½).
fn catmull_rom(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [0.5 * (-t3 + 2.0 * t2 - t), 0.5 * (3.0 * t3 - 5.0 * t2 + 2.0), 0.5 * (-3.0 * t3 + 4.0 * t2 + t), 0.5 * (t3 - t2)]
}
