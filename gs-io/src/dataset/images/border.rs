//! The black border around the image circle of a fish-eye.

use glam::{DVec2, dvec2};

use super::CompactImage;
use crate::image::{Pixels, Sample, with_pixels};

/// Largest value of a black pixel, 0 to 1: JPEG files are not exactly black beyond the image circle.
const BLACK: f32 = 8.0 / 255.0;

/// Least radius of an image circle that is found in an image, relative to the distance from the
/// principal point to the nearest side: a smaller bright disc is an object before black.
const LEAST_CIRCLE: f64 = 0.7;

/// How far interpolation reaches, px: pixels this close to the black border are darkened by it.
const BORDER: f64 = 2.0;

/// Masks what is outside of the image circle in the image of a wide fish-eye: if all pixels beyond a
/// circle about the principal point are black, they are none of the scene.
pub(crate) fn mask_border(image: &mut CompactImage, center: DVec2) {
    let (width, height) = image.size();
    let from_center = |i: usize| {
        let (x, y) = (i as u32 % width, i as u32 / width);
        dvec2(f64::from(x) + 0.5, f64::from(y) + 0.5).distance(center)
    };
    let count = width as usize * height as usize;
    let shown = with_pixels!(&image.pixels, pixels => {
        (0..count).filter(|&i| !is_black(pixels, i)).map(from_center).fold(0.0, f64::max)
    });
    let size = dvec2(f64::from(width), f64::from(height));
    let radius = shown.max(LEAST_CIRCLE * center.min(size - center).min_element());
    if (0..count).all(|i| from_center(i) <= radius) {
        return;
    }
    let mask = image.mask.get_or_insert_with(|| vec![true; count]);
    mask.iter_mut().enumerate().for_each(|(i, counts)| *counts &= from_center(i) <= radius - BORDER);
}

fn is_black<S: Sample>(pixels: &Pixels<S>, index: usize) -> bool {
    let [r, g, b, opacity] = pixels.number(index).map(|number| number / S::WHITE);
    [r, g, b].iter().all(|value| value * opacity <= BLACK)
}
