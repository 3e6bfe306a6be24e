//! Scales images down by averaging over areas.

use gs_core::Camera;

use super::{CompactImage, Window};
use crate::image::{AnyPixels, Pixels, Sample, with_pixels};

/// A pixel counts if at least this share of its area is covered; less is rounding.
const COVERED: f32 = 1e-4;

/// The camera of the same picture at another size.
pub(crate) fn resized(camera: &Camera, (width, height): (u32, u32)) -> Camera {
    let by = |new: u32, old: u32| f64::from(new) / f64::from(old);
    let scale = glam::dvec2(by(width, camera.width), by(height, camera.height));
    Camera {
        focal: (camera.focal.as_dvec2() * scale).as_vec2(),
        center: (camera.center.as_dvec2() * scale).as_vec2(),
        width,
        height,
        ..*camera
    }
}

/// The size of a picture scaled down to at most this many pixels on its longer side.
pub(crate) fn within((width, height): (u32, u32), max_side: u32) -> (u32, u32) {
    let longer = width.max(height);
    let scaled = |side: u32| ((f64::from(side) * f64::from(max_side) / f64::from(longer)).round() as u32).max(1);
    if longer > max_side { (scaled(width), scaled(height)) } else { (width, height) }
}

/// A picture that is scaled down, of which only a window is wanted.
pub(super) struct Shrinking {
    /// The size of the whole picture before and after scaling.
    old: (u32, u32),
    new: (u32, u32),
    /// The window, at the smaller scale.
    window: Window,
}

impl Shrinking {
    /// From the size `old` to `new`, which is no larger.
    pub(super) fn new(old: (u32, u32), new: (u32, u32), window: Window) -> Self {
        Self { old, new, window }
    }

    /// The window of the larger picture that [`Self::shrunk`] needs.
    pub(super) fn needed(&self) -> Window {
        let axis = |old: u32, new: u32, from: u32, length: u32| {
            let spans = spans(old, new, from, length);
            let (first, last) = (&spans[0], &spans[spans.len() - 1]);
            (first.first as u32, (last.first + last.weights.len() - first.first) as u32)
        };
        let Self { old, new, window } = *self;
        let (left, width) = axis(old.0, new.0, window.left, window.width);
        let (top, height) = axis(old.1, new.1, window.top, window.height);
        Window { left, top, width, height }
    }

    /// The window, made of the [needed](Self::needed) part: means of (premultiplied) colours over the area
    /// that counts. A pixel counts if any of its area does.
    pub(super) fn shrunk(&self, part: &CompactImage) -> CompactImage {
        let axis = |old: u32, new: u32, from: u32, length: u32| {
            let mut spans = spans(old, new, from, length);
            let first = spans[0].first;
            spans.iter_mut().for_each(|span| span.first -= first);
            spans
        };
        let Self { old, new, window } = *self;
        let columns = axis(old.0, new.0, window.left, window.width);
        let rows = axis(old.1, new.1, window.top, window.height);
        let (pixels, mask) = with_pixels!(&part.pixels, pixels => match (pixels.has_alpha, &part.mask) {
            (false, None) => (means(pixels, &columns, &rows), None),
            (_, mask) => weighted_means(pixels, mask.as_deref(), &columns, &rows),
        });
        CompactImage { pixels, mask }
    }
}

/// The means of opaque pixels.
fn means<S: Sample>(pixels: &Pixels<S>, columns: &[Span], rows: &[Span]) -> AnyPixels {
    let stride = 3 * pixels.width as usize;
    let mut samples = vec![S::default(); 3 * columns.len() * rows.len()];
    let mut line = vec![0.0; stride];
    for (samples, row) in samples.chunks_mut(3 * columns.len().max(1)).zip(rows) {
        line.fill(0.0);
        for (y, weight) in row.parts() {
            let stored = &pixels.samples[y * stride..][..stride];
            line.iter_mut().zip(stored).for_each(|(sum, sample)| *sum += weight * sample.number());
        }
        let line = line.as_chunks::<3>().0;
        for (pixel, column) in samples.as_chunks_mut::<3>().0.iter_mut().zip(columns) {
            let mut sums = [0.0; 3];
            for (values, weight) in line[column.first..].iter().zip(&column.weights) {
                sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
            }
            // Not `map`, which is not inlined.
            pixel.iter_mut().zip(sums).for_each(|(sample, sum)| *sample = S::nearest(sum));
        }
    }
    let (width, height) = (columns.len() as u32, rows.len() as u32);
    S::any(Pixels { width, height, has_alpha: false, samples })
}

/// Sums over the counting pixels below a new pixel: colour times alpha, alpha, and area.
type Sums = [f32; 5];

/// The means over pixels that count, weighted by their alpha.
fn weighted_means<S: Sample>(
    pixels: &Pixels<S>,
    mask: Option<&[bool]>,
    columns: &[Span],
    rows: &[Span],
) -> (AnyPixels, Option<Vec<bool>>) {
    let stride = pixels.width as usize;
    let mut sums: Vec<Sums> = vec![[0.0; 5]; columns.len() * rows.len()];
    let mut line: Vec<Sums> = vec![[0.0; 5]; stride];
    for (sums, row) in sums.chunks_mut(columns.len().max(1)).zip(rows) {
        line.fill([0.0; 5]);
        for (y, weight) in row.parts() {
            for (x, sums) in line.iter_mut().enumerate() {
                let index = y * stride + x;
                if mask.is_none_or(|mask| mask[index]) {
                    let [r, g, b, alpha] = pixels.number(index);
                    let alpha = alpha / S::WHITE;
                    add(sums, &[r * alpha, g * alpha, b * alpha, alpha, 1.0], weight);
                }
            }
        }
        for (sums, column) in sums.iter_mut().zip(columns) {
            column.parts().for_each(|(x, weight)| add(sums, &line[x], weight));
        }
    }
    let color = |&[r, g, b, opacity, _]: &Sums| {
        if opacity > 0.0 { [r / opacity, g / opacity, b / opacity] } else { [0.0; 3] }
    };
    let alpha = |&[.., opacity, area]: &Sums| if area > 0.0 { S::WHITE * opacity / area } else { 0.0 };
    let channels = pixels.channels();
    let pixel = |sums: &Sums| {
        let [r, g, b] = color(sums);
        [r, g, b, alpha(sums)].map(S::nearest).into_iter().take(channels)
    };
    let samples = sums.iter().flat_map(pixel).collect();
    let counts = || sums.iter().map(|&[.., area]| area > COVERED).collect();
    let (width, height) = (columns.len() as u32, rows.len() as u32);
    (S::any(Pixels { width, height, has_alpha: pixels.has_alpha, samples }), mask.map(|_| counts()))
}

fn add(sums: &mut Sums, values: &Sums, weight: f32) {
    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
}

/// The old pixels that a new one covers along an axis: the first, and the share of each.
struct Span {
    first: usize,
    weights: Vec<f32>,
}

impl Span {
    fn parts(&self) -> impl Iterator<Item = (usize, f32)> {
        (self.first..).zip(self.weights.iter().copied())
    }
}

/// The spans of `length` pixels from `from` on, of `new` over `old` ≥ `new`.
fn spans(old: u32, new: u32, from: u32, length: u32) -> Vec<Span> {
    let step = f64::from(old) / f64::from(new);
    let span = |i: u32| {
        let (start, end) = (f64::from(i) * step, f64::from(i + 1) * step);
        let (first, last) = (start.floor() as u32, (end.ceil() as u32).min(old));
        let covered = |k: u32| (f64::from(k + 1).min(end) - f64::from(k).max(start)).max(0.0) / step;
        Span { first: first as usize, weights: (first..last).map(|k| covered(k) as f32).collect() }
    };
    (from..from + length).map(span).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    use gs_core::Image;

    use super::super::PosedImage;

    fn opaque(width: u32, height: u32, color: impl Fn(u32, u32) -> [f32; 3]) -> PosedImage {
        PosedImage { image: Image::from_fn(width, height, color).unwrap(), alpha: None, mask: None }
    }

    fn shrunk(posed: &PosedImage, size: (u32, u32)) -> PosedImage {
        of_compact(&CompactImage::from(posed), size).to_posed().unwrap()
    }

    fn of_compact(image: &CompactImage, size: (u32, u32)) -> CompactImage {
        let shrinking = Shrinking::new(image.size(), size, Window::whole(size));
        assert_eq!(shrinking.needed(), Window::whole(image.size()));
        shrinking.shrunk(image)
    }

    #[test]
    fn the_longer_side_is_bounded() {
        assert_eq!(within((4000, 3000), 1600), (1600, 1200));
        assert_eq!(within((3000, 4001), 1600), (1200, 1600));
        assert_eq!(within((1600, 3), 1600), (1600, 3));
        assert_eq!(within((16_000, 1), 16), (16, 1));
    }

    #[test]
    fn each_pixel_is_the_mean_of_its_area() {
        let picture = opaque(5, 2, |x, y| [x as f32, y as f32, 1.0]);
        let small = shrunk(&picture, (2, 1));
        // Two and a half columns each: (0 + 1 + 2/2) / 2.5 and (2/2 + 3 + 4) / 2.5.
        let expected = [[0.8, 0.5, 1.0], [3.2, 0.5, 1.0]];
        for (pixel, expected) in small.image.pixels().iter().zip(expected) {
            assert!(pixel.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{pixel:?} {expected:?}");
        }
        assert_eq!((small.alpha, small.mask), (None, None));
        assert_eq!(shrunk(&picture, (5, 2)), picture, "at its own size nothing changes");
    }

    #[test]
    fn means_are_rounded_to_the_samples_of_the_file() {
        let samples = vec![12, 0, 255, 20, 1, 255, 32, 1, 255, 41, 2, 255];
        let pixels = u8::any(Pixels { width: 4, height: 1, has_alpha: false, samples });
        let small = of_compact(&CompactImage { pixels, mask: None }, (3, 1));
        // A column and a third each: (12 + 20/3) · 3/4 = 14, (20 + 32)/2 = 26 and (32/3 + 41) · 3/4 = 38.75.
        let expected = [14, 0, 255, 26, 1, 255, 39, 2, 255];
        let AnyPixels::Bits8(found) = &small.pixels else { panic!("{small:?}") };
        assert_eq!(found.samples, expected);
    }

    #[test]
    fn transparent_and_masked_pixels_give_no_colour() {
        let mut picture = opaque(4, 1, |x, _| [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]][x as usize % 2]);
        picture.alpha = Some(vec![1.0, 0.0, 0.5, 0.5]);
        let small = shrunk(&picture, (2, 1));
        assert_eq!(small.image.pixels(), [[1.0, 0.0, 0.0], [0.5, 0.5, 0.0]]);
        assert_eq!(small.alpha, Some(vec![0.5, 0.5]));
        picture.alpha = None;
        picture.mask = Some(vec![false, true, false, false]);
        let small = shrunk(&picture, (2, 1));
        assert_eq!(small.image.pixels(), [[0.0, 1.0, 0.0], [0.0; 3]]);
        assert_eq!(small.mask, Some(vec![true, false]));
    }

    #[test]
    fn a_world_point_keeps_its_place_in_the_picture() {
        let camera = Camera::looking_forward(400, 300, 1.0);
        let small = resized(&camera, (100, 77));
        let point = glam::Vec3::new(0.3, -0.2, 2.0);
        let place = |camera: &Camera| {
            camera.project(point).unwrap().0 / glam::UVec2::new(camera.width, camera.height).as_vec2()
        };
        assert!(place(&camera).abs_diff_eq(place(&small), 1e-6));
    }
}
