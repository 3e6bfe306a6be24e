//! The up direction of a scene that stands on something flat.

use std::f64::consts::{FRAC_PI_4, PI};

use glam::{DMat3, DVec3, Vec3};
use gs_core::{Scene as _, Scene3d, view::Bulk};

/// Number of directions that are tried: about one degree apart.
const DIRECTIONS: usize = 4000;

/// The largest angle between the ground's up direction and that of the scene, rad: walls are no ground.
const MOST_TILT: f64 = FRAC_PI_4;

/// Most Gaussians that are looked at.
const SAMPLES: usize = 20_000;

/// Layers in the radius of the scene.
const LAYERS: f64 = 50.0;

/// The fewest Gaussians that tell ground from chance.
const FEWEST: usize = 100;

/// The share of the Gaussians that lie in one layer of a scene with a ground.
const SHARE: f64 = 0.1;

/// How many times more there are than in the fullest layer across most other directions. Dense objects fill a layer
/// across any direction.
const ABOVE_USUAL: usize = 2;

/// Times that a plane is fitted to the layer that was found.
const ROUNDS: usize = 5;

/// The direction away from the plane that holds most Gaussians, among those near the scene's up direction.
/// `None` where no plane stands out.
pub(super) fn up_of_ground(scene: &Scene3d) -> Option<DVec3> {
    let bulk = Bulk::of(scene)?;
    let (center, radius) = (bulk.center.as_dvec3(), f64::from(bulk.radius));
    let near = |mean: &&Vec3| mean.as_dvec3().distance(center) <= radius;
    let stride = scene.len().div_ceil(SAMPLES);
    let places: Vec<DVec3> =
        scene.means.iter().step_by(stride).filter(near).map(|mean| (mean.as_dvec3() - center) / radius).collect();
    let mut tried: Vec<_> = (0..DIRECTIONS).map(direction).map(|up| (fullest(&places, up), up)).collect();
    tried.sort_unstable_by_key(|((count, _), _)| *count);
    let (((usual, _), _), ((count, layer), up)) = (tried[DIRECTIONS / 2], tried[DIRECTIONS - 1]);
    if places.len() < FEWEST || (count as f64) < SHARE * places.len() as f64 || count < ABOVE_USUAL * usual {
        return None;
    }
    refined(&places, up, (layer as f64 + 0.5) / LAYERS - 1.0)
}

/// A direction of a spiral around −y, as far as [`MOST_TILT`] from it.
fn direction(index: usize) -> DVec3 {
    let height = 1.0 - (1.0 - MOST_TILT.cos()) * (index as f64 + 0.5) / DIRECTIONS as f64;
    let (sin, cos) = (index as f64 * PI * (3.0 - 5f64.sqrt())).sin_cos();
    let across = (1.0 - height * height).sqrt();
    DVec3::new(across * cos, -height, across * sin)
}

/// The number of places in the fullest layer across a direction, and its number from below.
fn fullest(places: &[DVec3], up: DVec3) -> (usize, usize) {
    let mut counts = vec![0_usize; 2 * LAYERS as usize + 1];
    places.iter().for_each(|place| counts[((place.dot(up) + 1.0) * LAYERS).max(0.0) as usize] += 1);
    let fullest = counts.iter().enumerate().max_by_key(|(_, count)| **count);
    fullest.map_or((0, 0), |(layer, count)| (*count, layer))
}

/// The direction across the plane that is nearest to the places in a layer.
fn refined(places: &[DVec3], mut up: DVec3, mut height: f64) -> Option<DVec3> {
    for _ in 0..ROUNDS {
        let (u, v) = up.any_orthonormal_pair();
        // The height is a + b u + c v.
        let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
        for place in places.iter().filter(|place| (place.dot(up) - height).abs() <= 1.0 / LAYERS) {
            let row = DVec3::new(1.0, place.dot(u), place.dot(v));
            matrix += DMat3::from_cols(row * row.x, row * row.y, row * row.z);
            right += row * place.dot(up);
        }
        let [a, b, c] = (matrix.determinant() > 0.0).then(|| matrix.inverse() * right)?.to_array();
        let normal = up - b * u - c * v;
        (up, height) = (normal.normalize(), a / normal.length());
    }
    Some(up)
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs_core::Gaussian3d;

    /// A table, tilted by this rotation, with a ball on it and scattered strays.
    fn table(tilt: glam::DQuat, flat: usize) -> Scene3d {
        // Of Weyl's sequences with cubes, which lie in no planes as linear ones do.
        let random = |i: usize, k: usize| ((i as f64).powi(3) * [0.754_877, 0.569_840, 0.419_64][k]).fract() - 0.5;
        let place = |i: usize| match i {
            i if i < flat => DVec3::new(4.0 * random(i, 0), 0.01 * random(i, 2), 4.0 * random(i, 1)),
            i if i % 2 == 0 => DVec3::new(random(i, 0), random(i, 1) - 0.6, random(i, 2)),
            i => 4.0 * DVec3::new(random(i, 0), random(i, 1), random(i, 2)),
        };
        let gaussian = |i| Gaussian3d {
            mean: (tilt * place(i) + DVec3::new(3.0, -2.0, 7.0)).as_vec3(),
            log_scale: Vec3::splat(-4.0),
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit: 1.0,
            sh: vec![Vec3::ZERO],
        };
        (0..2000).map(gaussian).collect()
    }

    #[test]
    fn the_ground_is_found_and_straightened() {
        for tilt in [glam::DQuat::from_rotation_x(0.4), glam::DQuat::from_rotation_z(-0.6), glam::DQuat::IDENTITY] {
            let up = up_of_ground(&table(tilt, 1000)).unwrap();
            let off = up.angle_between(tilt * DVec3::NEG_Y).to_degrees();
            assert!(off < 0.2, "{off}° off");
        }
    }

    #[test]
    fn a_dense_ball_is_no_ground() {
        let mut scene = table(glam::DQuat::IDENTITY, 0);
        scene.means.iter_mut().step_by(2).for_each(|mean| *mean = 0.05 * *mean);
        assert_eq!(up_of_ground(&scene), None);
    }

    #[test]
    fn a_cloud_has_no_ground() {
        assert_eq!(up_of_ground(&table(glam::DQuat::IDENTITY, 0)), None);
    }
}
