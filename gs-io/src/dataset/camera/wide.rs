//! Wide fish-eyes: images of more than about 110° are split into 90° views as 360° images are.
//!
//! A single pinhole picture of such an angle spends most of its pixels on its corners. The views are
//! the faces of a cube around the camera of which the lens sees enough. Pixels of a face that the
//! image does not show are masked.

use glam::{DVec2, dvec2};

use super::{CubeFace, Distortion, Lens, SourceCamera};
use crate::dataset::PosedImage;

/// Widest picture of a fish-eye that stays a single pinhole view, horizontally and vertically, rad
/// (110°): its corners are stretched nine times, those of a 90° face five times.
const WIDEST_VIEW: f64 = 110.0 / 180.0 * std::f64::consts::PI;

/// Least share of a face's pixels that the image must show, or the face is no view.
const LEAST_SHARE: f64 = 0.05;

/// Points along each side of a face at which its share is measured.
const PROBES: u32 = 32;

/// Largest value of a black pixel, 0 to 1: JPEG files are not exactly black beyond the image circle.
const BLACK: f32 = 8.0 / 255.0;

/// Least radius of an image circle that is found in an image, relative to the distance from the
/// principal point to the nearest side: a smaller bright disc is an object before black.
const LEAST_CIRCLE: f64 = 0.7;

/// How far interpolation reaches, px: pixels this close to the black border are darkened by it.
const BORDER: f64 = 2.0;

/// The faces into which images of this camera are split, each with its lens; `None` if a single
/// pinhole view shows a fish-eye well enough, and for other lenses. `wide` is the lens beyond 89°. The
/// face behind the camera needs a stated image circle (`is_bounded`): otherwise only the corners of
/// the image would reach it, which usually are outside of the circle.
pub(crate) fn faces(source: &SourceCamera, wide: &Lens, is_bounded: bool) -> Option<Vec<(CubeFace, SourceCamera)>> {
    if !is_fisheye(source.lens.distortion()) || !is_too_wide(source) {
        return None;
    }
    let of_face = |face| (face, SourceCamera { lens: wide.facing(face), ..*source });
    let shows_enough = |(face, camera): &(CubeFace, SourceCamera)| match face {
        CubeFace::Front => true,
        CubeFace::Back if !is_bounded => false,
        _ => share(camera) >= LEAST_SHARE,
    };
    Some(CubeFace::ALL.into_iter().map(of_face).filter(shows_enough).collect())
}

/// Whether a distortion is of a fish-eye rather than of a perspective lens.
pub(crate) fn is_fisheye(distortion: &Distortion) -> bool {
    matches!(
        distortion,
        Distortion::Fisheye(_)
            | Distortion::AriaFisheye(_)
            | Distortion::FieldOfView { .. }
            | Distortion::EnhancedUnified { .. }
    )
}

/// Whether the pinhole picture of a camera would be wider or higher than [`WIDEST_VIEW`].
fn is_too_wide(source: &SourceCamera) -> bool {
    let picture = source.pinhole();
    let size = dvec2(f64::from(picture.width), f64::from(picture.height));
    let (before, after) = (picture.center / picture.focal, (size - picture.center) / picture.focal);
    [before.x.atan() + after.x.atan(), before.y.atan() + after.y.atan()].into_iter().any(|angle| angle > WIDEST_VIEW)
}

/// The share of a face's pixels that the image shows.
fn share(face: &SourceCamera) -> f64 {
    let at = |i: u32| 2.0 * (f64::from(i) + 0.5) / f64::from(PROBES) - 1.0;
    let rays = (0..PROBES).flat_map(|y| (0..PROBES).map(move |x| dvec2(at(x), at(y))));
    rays.filter(|ray| face.shows(*ray)).count() as f64 / f64::from(PROBES * PROBES)
}

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
