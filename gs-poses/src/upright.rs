//! Which way is up, from the cameras.

use glam::{DMat3, DQuat, DVec3};

use crate::model::Registered;

/// How much the mean of the cameras' own directions up counts where they all look the same way.
const MEAN_WEIGHT: f64 = 0.05;

/// Steps of the power iteration.
const STEPS: usize = 200;

/// The direction up in the stored pixels of a camera, by the EXIF orientation of its photograph.
fn up_in_camera(orientation: u8) -> DVec3 {
    match orientation {
        3 | 4 => DVec3::Y,
        5 | 6 => DVec3::NEG_X,
        7 | 8 => DVec3::X,
        _ => DVec3::NEG_Y,
    }
}

/// The rotation after which −y is up, as in COLMAP's and this engine's worlds, whose y is down.
///
/// People hold cameras level: up is at right angles to the horizontal axes of all cameras, on the side
/// on which their images are up. The orientation is that of a photograph's EXIF data.
pub(crate) fn upright(images: &[Registered], orientation: impl Fn(&str) -> u8) -> DQuat {
    let (mut mean, mut level) = (DVec3::ZERO, DMat3::ZERO);
    for image in images {
        let up = up_in_camera(orientation(&image.name));
        let to_world = image.rotation.inverse();
        mean += to_world * up;
        let side = to_world * up.cross(DVec3::Z);
        level += outer(side);
    }
    let count = images.len().max(1) as f64;
    let mean = (mean / count).normalize_or(DVec3::NEG_Y);
    // Smallest along up, and below 2.
    let cost = level * (1.0 / count) - outer(mean) * MEAN_WEIGHT;
    let mut up = mean;
    for _ in 0..STEPS {
        up = (up * 2.0 - cost * up).normalize_or(mean);
    }
    if up.dot(mean) < 0.0 {
        up = -up;
    }
    DQuat::from_rotation_arc(up, DVec3::NEG_Y)
}

fn outer(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cameras on a circle that look down at its middle, in a world that is turned.
    fn circle(world: DQuat, from: usize, to: usize, roll: impl Fn(usize) -> f64) -> Vec<Registered> {
        let camera = |i: usize| {
            let yaw = DQuat::from_rotation_y(i as f64 * std::f64::consts::TAU / 12.0);
            let to_world = world * yaw * DQuat::from_rotation_x(-0.6) * DQuat::from_rotation_z(roll(i));
            Registered {
                name: i.to_string(),
                rotation: to_world.inverse(),
                translation: DVec3::Z,
                observations: 0,
                focal: 1.0,
            }
        };
        (from..to).map(camera).collect()
    }

    #[test]
    fn up_is_found_whatever_way_the_cameras_look() {
        let world = DQuat::from_euler(glam::EulerRot::XYZ, 0.9, 0.2, -2.0);
        for (from, to, limit) in [(0, 12, 1e-3), (0, 4, 0.1)] {
            let turn = upright(&circle(world, from, to, |_| 0.0), |_| 1);
            let up = turn * (world * DVec3::NEG_Y);
            assert!(up.angle_between(DVec3::NEG_Y) < limit, "{from} to {to}: {up}");
        }
    }

    #[test]
    fn a_camera_on_its_side_is_turned_by_its_exif_orientation() {
        let world = DQuat::from_euler(glam::EulerRot::XYZ, 0.1, 0.5, 0.3);
        // Orientation 6: the left side of the stored pixels is up.
        let quarter = std::f64::consts::FRAC_PI_2;
        let images = circle(world, 0, 6, |i| if i % 2 == 0 { quarter } else { 0.0 });
        let turn = upright(&images, |name| if name.parse::<usize>().unwrap() % 2 == 0 { 6 } else { 1 });
        let up = turn * (world * DVec3::NEG_Y);
        assert!(up.angle_between(DVec3::NEG_Y) < 0.1, "{up}");
        let up_of = |orientation| images[0].rotation.inverse() * up_in_camera(orientation);
        assert!((world.inverse() * up_of(6)).y < -0.7 && (world.inverse() * up_of(8)).y > 0.7);
    }
}
