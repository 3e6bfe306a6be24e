//! 360° images split into the faces of a cube: six 90° pinhole views with the same camera position.
//!
//! An equirectangular image shows longitudes −π to π over its width and latitudes π/2 to −π/2 over
//! its height. Its middle is ahead of the camera; right and down in the image are right and down
//! from there. *Source:* COLMAP's `EQUIRECTANGULAR` (`sensor/models`) and Nerfstudio's
//! (`cameras/cameras.py`), which agree.

use glam::{DMat3, DVec2, DVec3, dvec2, dvec3};

use gs_core::Image;

use super::pose::Pose;

/// Least standard deviation of luma along a row or column for an image to be recognized as 360°.
const LEAST_SPREAD: f32 = 0.05;

/// Largest standard deviation of luma in a row that shows a single point, relative to the middle
/// row's.
const POLE_SPREAD: f32 = 0.1;

/// Differences of luma that count as rounding or noise.
const ROUNDING: f32 = 0.01;

gs_core::choices! {
    /// A face of the cube around a 360° camera, by its direction from the camera.
    #[derive(Default)]
    pub(crate) enum CubeFace {
        /// Ahead: the middle of the image.
        #[default]
        Front = "front",
        /// To the right.
        Right = "right",
        /// Behind: the left and right borders of the image.
        Back = "back",
        /// To the left.
        Left = "left",
        /// Above: the upper border of the image. Its lower border adjoins [`Self::Front`].
        Up = "up",
        /// Below: the lower border of the image. Its upper border adjoins [`Self::Front`].
        Down = "down",
    }
}

impl CubeFace {
    /// The rotation whose columns are the face's right, down and forward, in the axes of the 360°
    /// camera (right, down, forward).
    pub(crate) fn axes(self) -> DMat3 {
        let (right, down, forward) = match self {
            Self::Front => (DVec3::X, DVec3::Y, DVec3::Z),
            Self::Right => (DVec3::NEG_Z, DVec3::Y, DVec3::X),
            Self::Back => (DVec3::NEG_X, DVec3::Y, DVec3::NEG_Z),
            Self::Left => (DVec3::Z, DVec3::Y, DVec3::NEG_X),
            Self::Up => (DVec3::X, DVec3::Z, DVec3::NEG_Y),
            Self::Down => (DVec3::X, DVec3::NEG_Z, DVec3::Y),
        };
        DMat3::from_cols(right, down, forward)
    }

    /// The pose of the face, given that of the 360° camera.
    pub(crate) fn pose(self, camera: &Pose) -> Pose {
        let turn = self.axes().transpose();
        Pose { rotation: turn * camera.rotation, translation: turn * camera.translation }
    }

    /// Longitude and latitude of the face's ray (X/Z, Y/Z), rad. Latitude increases downwards.
    pub(crate) fn angles(self, ray: DVec2) -> DVec2 {
        let DVec3 { x, y, z } = self.axes() * ray.extend(1.0);
        dvec2(x.atan2(z), y.atan2(x.hypot(z)))
    }

    /// The face's ray (X/Z, Y/Z) at these angles; `None` behind the face.
    pub(crate) fn ray(self, angles: DVec2) -> Option<DVec2> {
        let ((sin_x, cos_x), (sin_y, cos_y)) = (angles.x.sin_cos(), angles.y.sin_cos());
        let ray = self.axes().transpose() * dvec3(sin_x * cos_y, sin_y, cos_x * cos_y);
        (ray.z > 0.0).then(|| ray.truncate() / ray.z)
    }
}

/// Side of a face, px, for an image of `width` px: about the resolution of the image at its middle.
pub(crate) fn face_side(width: u32) -> u32 {
    (width / 4).max(1)
}

/// Whether an image of this size can be a 360° image: twice as wide as high, apart from rounding.
pub(crate) fn is_two_to_one((width, height): (u32, u32)) -> bool {
    (i64::from(width) - 2 * i64::from(height)).abs() <= 2
}

/// Whether the borders of an image match as in a 360° image: the left and right columns continue
/// each other, and the upper and lower rows each show a single point.
pub(crate) fn shows_all_directions(image: &Image) -> bool {
    let (right, bottom) = (image.width() - 1, image.height() - 1);
    if right < 2 || bottom < 2 {
        return false;
    }
    let luma = |x: u32, y: u32| image.pixel(x, y).iter().sum::<f32>() / 3.0;
    let spread = |values: &mut dyn Iterator<Item = f32>| {
        let (count, sum, squares) =
            values.map(f64::from).fold((0.0, 0.0, 0.0), |(n, s, q), v| (n + 1.0, s + v, q + v * v));
        ((squares / count - (sum / count) * (sum / count)) as f32).max(0.0).sqrt()
    };
    let row = |y: u32| spread(&mut (0..=right).map(|x| luma(x, y)));
    let column = |x: u32| spread(&mut (0..=bottom).map(|y| luma(x, y)));
    let step =
        |a: u32, b: u32| (0..=bottom).map(|y| (luma(a, y) - luma(b, y)).abs()).sum::<f32>() / image.height() as f32;
    let middle = row(bottom / 2);
    // An image of one colour at its borders, such as a drawing, says nothing.
    let says_something = middle > LEAST_SPREAD && column(0) > LEAST_SPREAD;
    let closed = step(0, right) <= 2.0 * step(0, 1).max(step(right - 1, right)) + ROUNDING;
    says_something && closed && row(0).max(row(bottom)) <= POLE_SPREAD * middle + ROUNDING
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_look_where_their_names_say_and_are_not_mirrored() {
        use std::f64::consts::{FRAC_PI_2, PI};
        for (face, angles) in CubeFace::ALL.into_iter().zip([
            dvec2(0.0, 0.0),
            dvec2(FRAC_PI_2, 0.0),
            dvec2(PI, 0.0),
            dvec2(-FRAC_PI_2, 0.0),
            dvec2(0.0, -FRAC_PI_2),
            dvec2(0.0, FRAC_PI_2),
        ]) {
            assert_eq!(face.axes().determinant(), 1.0, "{face:?}");
            let found = face.angles(DVec2::ZERO);
            // The longitude of a pole means nothing.
            let same = (found.y - angles.y).abs() < 1e-12
                && (angles.y != 0.0
                    || (found.x.sin() - angles.x.sin()).abs() < 1e-12
                        && (found.x.cos() - angles.x.cos()).abs() < 1e-12);
            assert!(same, "{face:?}: {found}");
            for ray in [dvec2(0.3, -0.8), dvec2(-1.0, 0.99), dvec2(0.01, 0.02)] {
                assert!(face.ray(face.angles(ray)).unwrap().distance(ray) < 1e-12, "{face:?} {ray}");
            }
        }
        assert_eq!(CubeFace::Front.ray(dvec2(PI, 0.1)), None);
    }

    #[test]
    fn borders_of_faces_meet() {
        let same = |a: CubeFace, at: DVec2, b: CubeFace, other: DVec2| {
            let (a, b) = (a.axes() * at.extend(1.0), b.axes() * other.extend(1.0));
            assert!(a.distance(b) < 1e-12, "{a} {b}");
        };
        same(CubeFace::Front, dvec2(1.0, 0.4), CubeFace::Right, dvec2(-1.0, 0.4));
        same(CubeFace::Left, dvec2(1.0, 0.4), CubeFace::Front, dvec2(-1.0, 0.4));
        same(CubeFace::Right, dvec2(1.0, -0.4), CubeFace::Back, dvec2(-1.0, -0.4));
        same(CubeFace::Front, dvec2(0.4, -1.0), CubeFace::Up, dvec2(0.4, 1.0));
        same(CubeFace::Front, dvec2(0.4, 1.0), CubeFace::Down, dvec2(0.4, -1.0));
    }

    #[test]
    fn sizes_may_be_rounded() {
        assert!(is_two_to_one((4096, 2048)) && is_two_to_one((1001, 500)) && is_two_to_one((1000, 501)));
        assert!(!is_two_to_one((1000, 400)) && !is_two_to_one((4096, 4096)));
        assert_eq!((face_side(4096), face_side(3)), (1024, 1));
    }
}
