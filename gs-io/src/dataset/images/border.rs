//! The black border around the image circle of a fish-eye.

use glam::{DVec2, dvec2};

use super::PosedImage;

/// Largest value of a black pixel, 0 to 1: JPEG files are not exactly black beyond the image circle.
const BLACK: f32 = 8.0 / 255.0;

/// Least radius of an image circle that is found in an image, relative to the distance from the
/// principal point to the nearest side: a smaller bright disc is an object before black.
const LEAST_CIRCLE: f64 = 0.7;

/// How far interpolation reaches, px: pixels this close to the black border are darkened by it.
const BORDER: f64 = 2.0;

/// Masks what is outside of the image circle in the image of a wide fish-eye: if all pixels beyond a
/// circle about the principal point are black, they are none of the scene.
pub(crate) fn mask_border(posed: &mut PosedImage, center: DVec2) {
    let (width, height) = posed.image.size();
    let from_center = |i: usize| {
        let (x, y) = (i as u32 % width, i as u32 / width);
        dvec2(f64::from(x) + 0.5, f64::from(y) + 0.5).distance(center)
    };
    let opacity = |i: usize| posed.alpha.as_ref().map_or(1.0, |alpha| alpha[i]);
    let is_black = |i: usize, pixel: &[f32; 3]| pixel.iter().all(|value| value * opacity(i) <= BLACK);
    let pixels = posed.image.pixels().iter().enumerate();
    let shown = pixels.filter(|(i, pixel)| !is_black(*i, pixel)).map(|(i, _)| from_center(i)).fold(0.0, f64::max);
    let size = dvec2(f64::from(width), f64::from(height));
    let radius = shown.max(LEAST_CIRCLE * center.min(size - center).min_element());
    let count = posed.image.pixels().len();
    if (0..count).all(|i| from_center(i) <= radius) {
        return;
    }
    let mask = posed.mask.get_or_insert_with(|| vec![true; count]);
    mask.iter_mut().enumerate().for_each(|(i, counts)| *counts &= from_center(i) <= radius - BORDER);
}
