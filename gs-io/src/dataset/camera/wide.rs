//! Wide fish-eyes: images of more than about 110° are split into 90° views as 360° images are.
//!
//! A single pinhole picture of such an angle spends most of its pixels on its corners. The views are
//! the faces of a cube around the camera of which the lens sees enough. Pixels of a face that the
//! image does not show are masked.

use glam::dvec2;

use super::{CubeFace, Distortion, Lens, SourceCamera};

/// Widest picture of a fish-eye that stays a single pinhole view, horizontally and vertically, rad
/// (110°): its corners are stretched nine times, those of a 90° face five times.
const WIDEST_VIEW: f64 = 110.0 / 180.0 * std::f64::consts::PI;

/// Least share of a face's pixels that the image must show, or the face is no view.
const LEAST_SHARE: f64 = 0.05;

/// Points along each side of a face at which its share is measured.
const PROBES: u32 = 32;

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
