//! The common motion of all cameras, which images do not show: a similarity of the world.

use glam::{DMat3, DQuat, DVec3};
use gs_core::{Camera, math::similarity::Similarity};

use super::{align::solve, descent::Descent};

/// Change of the numbers of a similarity by which derivatives are measured. Cameras are stored with 24 bits.
const CHANGE: f64 = 1e-3;

/// Weight of no motion, relative to the mean weight of the cameras: what moves the images by a hundredth of what
/// other motions do is not known.
const DAMPING: f64 = 1e-4;

/// The similarity with these numbers: a turn about `center` in rad, a shift in units of `extent`, and ln of the
/// scale.
fn similarity(numbers: [f64; 7], center: DVec3, extent: f64) -> Similarity {
    let [turn, shift] = [0, 3].map(|k| DVec3::from_slice(&numbers[k..k + 3]));
    let rotation = DQuat::from_scaled_axis(turn);
    Similarity { rotation, scale: numbers[6].exp(), from: center, to: center + extent * shift }
}

/// A camera that sees the same after the world has moved.
fn moved_with(camera: &Camera, world: &Similarity) -> Camera {
    let rotation = camera.rotation.as_dmat3();
    let position = world.apply(-(rotation.transpose() * camera.translation.as_dvec3()));
    let rotation = rotation * DMat3::from_quat(world.rotation.inverse());
    Camera { rotation: rotation.as_mat3(), translation: (-(rotation * position)).as_vec3(), ..*camera }
}

/// Turns, shifts and scales the moved cameras together, so that their images are as close as possible to those of
/// the given ones: the least squares of how far the scene's points are apart, px. Returns what it did, or `None`
/// where that is not known and nothing was done.
pub(super) fn keep(cameras: &mut [Camera], given: &[(Camera, &Descent)], extent: f64) -> Option<Similarity> {
    let center = cameras.iter().map(|camera| camera.position().as_dvec3()).sum::<DVec3>() / cameras.len() as f64;
    let (mut matrix, mut right) = ([[0.0; 7]; 7], [0.0; 7]);
    for (camera, (given, descent)) in cameras.iter().zip(given) {
        let apart = descent.pixels(given, camera);
        let slopes: [[f64; 6]; 7] = std::array::from_fn(|i| {
            let mut numbers = [0.0; 7];
            numbers[i] = CHANGE;
            let changed = descent.pixels(given, &moved_with(camera, &similarity(numbers, center, extent)));
            std::array::from_fn(|k| (changed[k] - apart[k]) / CHANGE)
        });
        let dot = |a: &[f64; 6], b: &[f64; 6]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        for i in 0..7 {
            (0..=i).for_each(|j| matrix[i][j] += dot(&slopes[i], &slopes[j]));
            right[i] -= dot(&slopes[i], &apart);
        }
    }
    let damping = DAMPING * (0..7).map(|i| matrix[i][i]).sum::<f64>() / 7.0;
    (0..7).for_each(|i| matrix[i][i] += damping);
    let common = similarity(solve(matrix, right)?, center, extent);
    cameras.iter_mut().for_each(|camera| *camera = moved_with(camera, &common));
    Some(common)
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
        let points: Vec<Vec3> =
            (0..40).map(|i| Vec3::new((i as f32).sin(), (2.4 * i as f32).cos(), 0.05 * i as f32 - 1.0)).collect();
        let descents: Vec<Descent> = given.iter().map(|camera| Descent::of(camera, &points)).collect();
        let of_given: Vec<(Camera, &Descent)> = given.iter().copied().zip(&descents).collect();
        let mut moved: Vec<Camera> = given.iter().map(common).collect();
        assert!(far(&given[0], &moved[0]) > 0.03);
        keep(&mut moved, &of_given, 3.0).unwrap();
        // The angles are small, and their squares are left.
        assert!(given.iter().zip(&moved).all(|(a, b)| far(a, b) < 1e-3), "{moved:?}");
        let mut single = given.clone();
        single[3] = single[3].moved(0.1 * Vec3::X, 0.05 * Vec3::Y);
        let wanted = descents[3].distance(&given[3], &single[3]);
        keep(&mut single, &of_given, 3.0).unwrap();
        assert!(descents[3].distance(&given[3], &single[3]) > 0.7 * wanted);
        // Cameras in one place do not tell the scale, and those that see nothing tell nothing.
        let at_one_place = vec![(given[0], &descents[0]); 3];
        let kept = keep(&mut vec![given[0]; 3], &at_one_place, 3.0).unwrap();
        assert!(kept.scale == 1.0 && kept.apply(glam::DVec3::X).distance(glam::DVec3::X) < 1e-6, "{kept:?}");
        let blind = Descent::of(&given[0], &[]);
        assert!(keep(&mut [given[0]], &[(given[0], &blind)], 3.0).is_none());
    }
}
