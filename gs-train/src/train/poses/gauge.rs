//! The common motion of all cameras, which images do not show: a similarity of the world.

use glam::{DMat3, DVec3};
use gs_core::{Camera, math::similarity::Similarity};

/// Least spread of cameras relative to the extent of the scene from which their common scale is known.
const LEAST_SPREAD: f64 = 1e-2;

/// A camera's position and its axes in the world, in columns.
fn placed(camera: &Camera) -> (DVec3, DMat3) {
    let rotation = camera.rotation.as_dmat3();
    (-(rotation.transpose() * camera.translation.as_dvec3()), rotation.transpose())
}

/// Turns, shifts and scales the moved cameras together, so that they are as close as possible to the given
/// ones, in the least squares. An angle counts as much as the distance that it spans at `extent`.
pub(super) fn keep(given: &[Camera], moved: &mut [Camera], extent: f64) {
    let places: Vec<_> = given.iter().zip(&*moved).map(|(given, moved)| (placed(given), placed(moved))).collect();
    let pairs: Vec<_> = places.iter().map(|((to, _), (from, _))| (*from, *to, 1.0)).collect();
    // The squared distance of two rotations as matrices is twice the square of the angle between them.
    let turns = places.iter().fold(DMat3::ZERO, |sum, ((_, to), (_, from))| sum + *to * from.transpose());
    let Some(mut common) = Similarity::between(&pairs, turns * (extent * extent / 2.0)) else { return };
    let spread = pairs.iter().map(|(from, ..)| from.distance_squared(common.from)).sum::<f64>();
    if spread <= pairs.len() as f64 * (LEAST_SPREAD * extent).powi(2) {
        common.scale = 1.0;
    }
    let turn = DMat3::from_quat(common.rotation);
    for (camera, (_, (position, axes))) in moved.iter_mut().zip(places) {
        let (position, axes) = (common.apply(position), turn * axes);
        let rotation = axes.transpose();
        (camera.rotation, camera.translation) = (rotation.as_mat3(), (-(rotation * position)).as_vec3());
    }
}

#[cfg(test)]
mod tests {
    use glam::{Mat3, Vec3};

    use super::*;

    #[test]
    fn a_common_motion_is_undone_and_a_single_one_is_not() {
        let lens = Camera::looking_forward(64, 48, 1.0);
        let around = |i: u32| {
            let position = 3.0 * Vec3::new((i as f32).cos(), (i as f32).sin(), 0.3 * (2.0 * i as f32).sin());
            lens.looking_at(position, Vec3::ZERO, Vec3::Z).unwrap()
        };
        let given: Vec<Camera> = (0..8).map(around).collect();
        let turn = Mat3::from_axis_angle(Vec3::new(2.0, -1.0, 2.0) / 3.0, 0.01);
        let common = |camera: &Camera| {
            let rotation = camera.rotation * turn;
            let position = turn.transpose() * (1.01 * camera.position() - Vec3::new(0.02, 0.01, -0.03));
            Camera { rotation, translation: -(rotation * position), ..*camera }
        };
        let far = |a: &Camera, b: &Camera| {
            let turn = (a.rotation * b.rotation.transpose() - Mat3::IDENTITY).to_cols_array();
            turn.into_iter().fold(a.position().distance(b.position()), |most, value| most.max(value.abs()))
        };
        let mut moved: Vec<Camera> = given.iter().map(common).collect();
        assert!(far(&given[0], &moved[0]) > 0.03);
        keep(&given, &mut moved, 3.0);
        assert!(given.iter().zip(&moved).all(|(a, b)| far(a, b) < 1e-5), "{moved:?}");
        let mut single = given.clone();
        single[3] = single[3].moved(0.1 * Vec3::X, 0.05 * Vec3::Y);
        let wanted = far(&given[3], &single[3]);
        keep(&given, &mut single, 3.0);
        assert!(far(&given[3], &single[3]) > 0.7 * wanted);
    }
}
