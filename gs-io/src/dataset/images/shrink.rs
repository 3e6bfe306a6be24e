//! Scales images down by averaging over areas.

use gs_core::{Camera, Error, Image};
use rayon::prelude::*;

use super::PosedImage;

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

/// Sums over the counting pixels below a new pixel: colour times alpha, alpha, and area.
type Sums = [f32; 5];

/// The image at a size no larger than its own: means of (premultiplied) colours over the area that
/// counts. A pixel counts if any of its area does.
pub(crate) fn shrunk(posed: &PosedImage, (width, height): (u32, u32)) -> Result<PosedImage, Error> {
    let PosedImage { image, alpha, mask } = posed;
    let (columns, rows) = (spans(image.width(), width), spans(image.height(), height));
    let stride = image.width() as usize;
    let mut sums: Vec<Sums> = vec![[0.0; 5]; width as usize * height as usize];
    let lines = sums.par_chunks_mut(columns.len().max(1)).zip(&rows);
    lines.for_each_init(
        || vec![[0.0; 5]; stride],
        |line, (sums, row)| {
            line.fill([0.0; 5]);
            for (y, weight) in row.parts() {
                for (x, sums) in line.iter_mut().enumerate() {
                    let index = y * stride + x;
                    if mask.as_ref().is_none_or(|mask| mask[index]) {
                        let alpha = alpha.as_ref().map_or(1.0, |alpha| alpha[index]);
                        let [r, g, b] = image.pixels()[index];
                        add(sums, &[r * alpha, g * alpha, b * alpha, alpha, 1.0], weight);
                    }
                }
            }
            for (sums, column) in sums.iter_mut().zip(&columns) {
                column.parts().for_each(|(x, weight)| add(sums, &line[x], weight));
            }
        },
    );
    let color = |&[r, g, b, opacity, _]: &Sums| {
        if opacity > 0.0 { [r / opacity, g / opacity, b / opacity] } else { [0.0; 3] }
    };
    let colors = sums.iter().map(color).collect();
    let alphas = || sums.iter().map(|&[.., opacity, area]| if area > 0.0 { opacity / area } else { 0.0 }).collect();
    let counts = || sums.iter().map(|&[.., area]| area > COVERED).collect();
    let image = Image::from_pixels(width, height, colors)?;
    Ok(PosedImage { image, alpha: alpha.as_ref().map(|_| alphas()), mask: mask.as_ref().map(|_| counts()) })
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

/// The spans of `new` pixels over `old` ≥ `new`.
fn spans(old: u32, new: u32) -> Vec<Span> {
    let step = f64::from(old) / f64::from(new);
    let span = |i: u32| {
        let (start, end) = (f64::from(i) * step, f64::from(i + 1) * step);
        let (first, last) = (start.floor() as u32, (end.ceil() as u32).min(old));
        let covered = |k: u32| (f64::from(k + 1).min(end) - f64::from(k).max(start)).max(0.0) / step;
        Span { first: first as usize, weights: (first..last).map(|k| covered(k) as f32).collect() }
    };
    (0..new).map(span).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn opaque(width: u32, height: u32, color: impl Fn(u32, u32) -> [f32; 3]) -> PosedImage {
        PosedImage { image: Image::from_fn(width, height, color).unwrap(), alpha: None, mask: None }
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
        let small = shrunk(&picture, (2, 1)).unwrap();
        // Two and a half columns each: (0 + 1 + 2/2) / 2.5 and (2/2 + 3 + 4) / 2.5.
        let expected = [[0.8, 0.5, 1.0], [3.2, 0.5, 1.0]];
        for (pixel, expected) in small.image.pixels().iter().zip(expected) {
            assert!(pixel.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{pixel:?} {expected:?}");
        }
        assert_eq!((small.alpha, small.mask), (None, None));
        assert_eq!(shrunk(&picture, (5, 2)).unwrap(), picture, "at its own size nothing changes");
    }

    #[test]
    fn transparent_and_masked_pixels_give_no_colour() {
        let mut picture = opaque(4, 1, |x, _| [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]][x as usize % 2]);
        picture.alpha = Some(vec![1.0, 0.0, 0.5, 0.5]);
        let small = shrunk(&picture, (2, 1)).unwrap();
        assert_eq!(small.image.pixels(), [[1.0, 0.0, 0.0], [0.5, 0.5, 0.0]]);
        assert_eq!(small.alpha, Some(vec![0.5, 0.5]));
        picture.alpha = None;
        picture.mask = Some(vec![false, true, false, false]);
        let small = shrunk(&picture, (2, 1)).unwrap();
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
