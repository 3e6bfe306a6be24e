//! Properties of a scene that follow from its cameras: its extent, and their focus.

use glam::{DMat3, DVec3, Vec3};
use gs_core::{
    Camera,
    constants::{NEAREST_POINTS, ONE_PLACE},
};

/// Distance of a camera from the others that rounding of `f32` alone may leave, world units.
const LEAST_SPREAD: f64 = 1e-5;

/// Extent of a scene, world units, in which learning rates and sizes are expressed.
///
/// It is 1.1 times the largest distance of a camera from the mean of all camera positions
/// (*source:* the code of 3DGS). For cameras in one place ([`ONE_PLACE`]) it is the median distance of
/// the scene's `points` from there, or 1 without any.
pub fn extent_of<'a>(cameras: impl IntoIterator<Item = &'a Camera>, points: &[Vec3]) -> f32 {
    let positions: Vec<DVec3> = cameras.into_iter().map(|camera| camera.position().as_dvec3()).collect();
    let mean = positions.iter().sum::<DVec3>() / positions.len().max(1) as f64;
    let spread = positions.iter().map(|position| position.distance(mean)).fold(0.0, f64::max);
    let mut distances: Vec<f64> = points.iter().map(|point| point.as_dvec3().distance(mean)).collect();
    distances.retain(|distance| distance.is_finite());
    distances.sort_by(f64::total_cmp);
    let distance = |share: f64| distances.get((share * distances.len() as f64) as usize).copied();
    let least = distance(NEAREST_POINTS).map_or(LEAST_SPREAD, |nearest| LEAST_SPREAD.max(ONE_PLACE * nearest));
    let extent = if spread > least { 1.1 * spread } else { distance(0.5).unwrap_or(1.0) } as f32;
    if extent > 0.0 && extent.is_finite() { extent } else { 1.0 }
}

/// The point that the cameras look at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Focus {
    /// Point nearest to all optical axes, in the least squares, world units.
    pub point: Vec3,
    /// Median distance of the cameras from the point, world units.
    pub distance: f32,
}

impl Focus {
    /// The focus of cameras: where axes meet, in front of most cameras and within their images.
    ///
    /// Cameras that look to all sides, or side by side into the distance, have none.
    pub fn of<'a>(cameras: impl IntoIterator<Item = &'a Camera>) -> Option<Self> {
        let cameras: Vec<&Camera> = cameras.into_iter().collect();
        let (mut sum, mut right) = (DMat3::ZERO, DVec3::ZERO);
        for camera in &cameras {
            let axis = camera.rotation.row(2).as_dvec3().normalize_or_zero();
            // The distance of x from the axis is |P (x − o)|, with P the projection along the axis.
            let projection = DMat3::IDENTITY - DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
            sum += projection;
            right += projection * camera.position().as_dvec3();
        }
        // det of the mean projection is 8/27 for axes from everywhere, 1/4 for those of a ring, and
        // 0 for parallel ones.
        let count = cameras.len() as f64;
        if !((sum * (1.0 / count)).determinant() > 1e-4) {
            return None;
        }
        let point = (sum.inverse() * right).as_vec3();
        let sees = |camera: &&&Camera| {
            let size = glam::Vec2::new(camera.width as f32, camera.height as f32);
            camera.project(point).is_some_and(|(at, _)| at.cmpge(glam::Vec2::ZERO).all() && at.cmple(size).all())
        };
        if !point.is_finite() || 4 * cameras.iter().filter(sees).count() < 3 * cameras.len() {
            return None;
        }
        let mut distances: Vec<f32> = cameras.iter().map(|camera| camera.position().distance(point)).collect();
        distances.sort_by(f32::total_cmp);
        let distance = distances[distances.len() / 2];
        (distance > 0.0).then_some(Self { point, distance })
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use glam::{Mat3, Vec2};

    use super::*;

    /// A camera at `position` that looks at `target`, y down.
    pub(crate) fn looking_at(position: Vec3, target: Vec3, side: u32) -> Camera {
        let forward = (target - position).normalize();
        let right = forward.cross(Vec3::new(0.1, 0.2, 1.0)).normalize();
        let rotation = Mat3::from_cols(right, forward.cross(right), forward).transpose();
        let camera = Camera::looking_forward(side, side, 0.9);
        Camera { rotation, translation: -(rotation * position), ..camera }
    }

    #[test]
    fn the_extent_is_that_of_3dgs() {
        let at = |x: f32| looking_at(Vec3::new(x, 0.0, 0.0), Vec3::new(0.0, 5.0, 0.0), 8);
        let cameras = [at(-1.0), at(0.0), at(4.0)];
        assert!((extent_of(&cameras, &[]) - 1.1 * 3.0).abs() < 1e-5);
        assert_eq!(extent_of(&[], &[Vec3::NAN]), 1.0);
    }

    /// Rounding, text and a head that pans move cameras that stand in one place.
    #[test]
    fn cameras_in_one_place_have_the_extent_of_the_points() {
        let points: Vec<Vec3> = (0..20).map(|i| 7.0 * Vec3::new((i as f32).cos(), (i as f32).sin(), 0.0)).collect();
        let with_sky: Vec<Vec3> = points.iter().copied().chain((0..20).map(|i| Vec3::Z * (1e4 + i as f32))).collect();
        for jitter in [0.0, 2e-6, 1e-4, 1e-2] {
            let at = |x: f32| looking_at(Vec3::X * x, Vec3::new(0.0, 5.0, 0.0), 8);
            let cameras = [at(-jitter), at(0.0), at(jitter)];
            assert!((extent_of(&cameras, &points) - 7.0).abs() < 0.02, "{jitter}");
        }
        let cameras = [-0.1, 0.1].map(|x| looking_at(Vec3::X * x, Vec3::Y, 8));
        assert!((extent_of(&cameras, &with_sky) - 0.11).abs() < 1e-5);
        assert_eq!(extent_of(&cameras[..1], &[]), 1.0);
    }

    #[test]
    fn cameras_around_an_object_look_at_it() {
        let object = Vec3::new(3.0, -1.0, 0.5);
        let around = |i: usize| {
            let angle = i as f32;
            looking_at(object + 4.0 * Vec3::new(angle.cos(), angle.sin(), 0.3), object, 40)
        };
        let focus = Focus::of(&(0..9).map(around).collect::<Vec<_>>()).unwrap();
        assert!((focus.point - object).length() < 1e-4, "{focus:?}");
        assert!((focus.distance - 4.0 * 1.09f32.sqrt()).abs() < 1e-3);
    }

    #[test]
    fn cameras_that_look_apart_or_side_by_side_have_no_focus() {
        let apart = |i: usize| {
            let angle = i as f32;
            let direction = Vec3::new(angle.cos(), angle.sin(), 0.1);
            looking_at(direction, 3.0 * direction, 40)
        };
        assert_eq!(Focus::of(&(0..9).map(apart).collect::<Vec<_>>()), None);
        let beside = |i: usize| looking_at(Vec3::X * i as f32, Vec3::new(i as f32, 100.0, 0.0), 40);
        assert_eq!(Focus::of(&(0..9).map(beside).collect::<Vec<_>>()), None);
        let odd = Camera { center: Vec2::splat(-90.0), ..beside(0) };
        assert_eq!(Focus::of(&[odd]), None);
        assert_eq!(Focus::of(&[]), None);
    }
}
