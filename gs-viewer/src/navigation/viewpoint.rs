//! The viewpoint as a target, a distance and three angles, so that rounding errors do not add up.
//! Only yaw and pitch ever change, so that the horizon stays as level as it was at first.

use std::f32::consts::{FRAC_PI_2, PI, TAU};

use glam::{Mat3, Vec2, Vec3};
use gs_core::Camera;

/// Smallest cosine of the pitch at which yaw and roll differ. Nearer to straight up or down they
/// are the same turn, which counts as yaw.
const POLE: f32 = 1e-3;

/// The axes of angles: right-handed, of unit length.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Horizon {
    /// Yaw 0.
    ahead: Vec3,
    /// Yaw of a quarter turn.
    aside: Vec3,
    up: Vec3,
}

impl Horizon {
    /// The horizon for an up direction; −y if that has no length.
    fn below(up: Vec3) -> Self {
        let up = up.try_normalize().unwrap_or(Vec3::NEG_Y);
        let ahead = up.any_orthonormal_vector();
        Self { ahead, aside: up.cross(ahead), up }
    }
}

/// A viewpoint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Viewpoint {
    /// The target, world units.
    pub(crate) target: Vec3,
    /// Distance from the eye to the target, world units; positive.
    pub(crate) distance: f32,
    /// Angle around the up direction, counter-clockwise as seen from above, rad, −π to π.
    yaw: f32,
    /// Angle above the horizon, rad, −π/2 to π/2.
    pitch: f32,
    /// Angle of the camera around its own axis, clockwise, rad. It is that of the first camera.
    roll: f32,
    horizon: Horizon,
}

/// The camera's axes in the world, of unit length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Axes {
    pub(crate) right: Vec3,
    pub(crate) down: Vec3,
    pub(crate) forward: Vec3,
}

impl Viewpoint {
    /// The viewpoint of a camera whose target is `distance` ahead. Turns are around `up`.
    pub(crate) fn of(camera: &Camera, distance: f32, up: Vec3) -> Self {
        let horizon = Horizon::below(up);
        let [right, forward] = [camera.rotation.row(0), camera.rotation.row(2).normalize_or(Vec3::Z)];
        let level = Vec2::new(forward.dot(horizon.ahead), forward.dot(horizon.aside));
        let yaw = if level.length() > POLE {
            level.to_angle()
        } else {
            f32::atan2(right.dot(horizon.ahead), -right.dot(horizon.aside))
        };
        let pitch = f32::atan2(forward.dot(horizon.up), level.length());
        let target = camera.position() + distance * forward;
        let mut viewpoint = Self { target, distance, yaw, pitch, roll: 0.0, horizon };
        let upright = viewpoint.axes();
        viewpoint.roll = f32::atan2(right.dot(upright.down), right.dot(upright.right));
        viewpoint
    }

    /// Where the camera's axes point.
    pub(crate) fn axes(&self) -> Axes {
        let Horizon { ahead, aside, up } = self.horizon;
        let ((sin_yaw, cos_yaw), (sin_pitch, cos_pitch)) = (self.yaw.sin_cos(), self.pitch.sin_cos());
        let forward = cos_pitch * (cos_yaw * ahead + sin_yaw * aside) + sin_pitch * up;
        let level = sin_yaw * ahead - cos_yaw * aside;
        let upright = forward.cross(level);
        let (sin, cos) = self.roll.sin_cos();
        Axes { right: cos * level + sin * upright, down: cos * upright - sin * level, forward }
    }

    /// Where the camera is, world units.
    pub(crate) fn eye(&self) -> Vec3 {
        self.target - self.distance * self.axes().forward
    }

    /// The camera here, with the intrinsics of `lens`.
    pub(crate) fn camera(&self, lens: &Camera) -> Camera {
        let Axes { right, down, forward } = self.axes();
        let rotation = Mat3::from_cols(right, down, forward).transpose();
        Camera { rotation, translation: -(rotation * self.eye()), ..*lens }
    }

    /// Turns the camera around the target; `angles` to the right and downwards in the picture, rad.
    /// Pitch ends at straight up and down.
    pub(crate) fn orbit(&mut self, angles: Vec2) {
        // In the picture of a tilted camera, the horizon is not level.
        let angles = Vec2::from_angle(self.roll).rotate(angles);
        self.yaw = wrapped(self.yaw - angles.x);
        self.pitch = (self.pitch - angles.y).clamp(-FRAC_PI_2, FRAC_PI_2);
    }

    /// Turns the camera on the spot; `angles` as for [`Self::orbit`].
    pub(crate) fn look(&mut self, angles: Vec2) {
        let eye = self.eye();
        self.orbit(angles);
        self.target = eye + self.distance * self.axes().forward;
    }

    /// Moves the camera sideways, so that the target moves by `shift` in the picture, px to the
    /// right and downwards; `focal` is the camera's, px.
    pub(crate) fn pan(&mut self, shift: Vec2, focal: Vec2) {
        let Axes { right, down, .. } = self.axes();
        let Vec2 { x, y } = self.distance * shift / focal;
        self.target -= x * right + y * down;
    }

    /// Moves the camera and its target to the right, up in the world, and forward, world units.
    pub(crate) fn walk(&mut self, steps: Vec3) {
        let Axes { right, forward, .. } = self.axes();
        self.target += steps.x * right + steps.y * self.horizon.up + steps.z * forward;
    }
}

/// Returns this angle from −π to π, so that many turns stay exact.
fn wrapped(angle: f32) -> f32 {
    // An angle in the range is not rounded.
    if angle.abs() <= PI { angle } else { (angle + PI).rem_euclid(TAU) - PI }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lens() -> Camera {
        Camera::looking_forward(80, 60, 0.9)
    }

    fn start() -> Viewpoint {
        let camera = lens().looking_at(Vec3::new(3.0, -2.0, 1.0), Vec3::new(0.5, 0.0, 0.0), Vec3::NEG_Y).unwrap();
        Viewpoint::of(&camera, camera.position().distance(Vec3::new(0.5, 0.0, 0.0)), Vec3::NEG_Y)
    }

    fn close(a: &Camera, b: &Camera, tolerance: f32) -> bool {
        a.rotation.abs_diff_eq(b.rotation, tolerance) && a.translation.abs_diff_eq(b.translation, tolerance)
    }

    /// Any camera: tilted, upside down, in any direction.
    fn cameras() -> impl Iterator<Item = Camera> {
        (0..60).map(|i| {
            let t = i as f32;
            let rotation = Mat3::from_euler(glam::EulerRot::XYZ, 0.7 * t, 1.3 * t, 2.9 * t);
            Camera { rotation, translation: Vec3::new(t.sin(), t.cos(), 2.0), ..lens() }
        })
    }

    #[test]
    fn the_first_camera_is_kept() {
        for (i, camera) in cameras().enumerate() {
            for up in [Vec3::NEG_Y, Vec3::Z, Vec3::new(1.0, 2.0, -0.5), camera.rotation.row(2), -camera.rotation.row(2)]
            {
                let seen = Viewpoint::of(&camera, 3.0, up).camera(&lens());
                // Near the poles, the horizon has large rounding errors.
                assert!(close(&seen, &camera, 3e-3), "{i}, {up}: {seen:?} {camera:?}");
                seen.validate().unwrap();
            }
        }
    }

    #[test]
    fn a_full_turn_returns() {
        let mut viewpoint = start();
        let home = viewpoint.camera(&lens());
        for step in 1..=360 {
            viewpoint.orbit(Vec2::new(TAU / 360.0, 0.0));
            let away = viewpoint.camera(&lens());
            assert!(step == 360 || !close(&away, &home, 1e-3), "{step}");
            assert!((away.position().distance(viewpoint.target) - start().distance).abs() < 1e-5, "{step}");
        }
        assert!(close(&viewpoint.camera(&lens()), &home, 1e-4));
        // Also after a hundred turns and back.
        (0..36_000).for_each(|_| viewpoint.orbit(Vec2::new(TAU / 360.0, 0.0)));
        (0..36_000).for_each(|_| viewpoint.orbit(Vec2::new(-TAU / 360.0, 0.0)));
        assert!(close(&viewpoint.camera(&lens()), &home, 5e-3));
    }

    #[test]
    fn dragged_points_follow_the_pointer() {
        let near_side = |viewpoint: &Viewpoint| viewpoint.target - 0.2 * start().axes().forward;
        let place = |viewpoint: &Viewpoint, point: Vec3| viewpoint.camera(&lens()).project(point).unwrap().0;
        let mut turned = start();
        let point = near_side(&turned);
        let before = place(&turned, point);
        turned.orbit(Vec2::new(0.1, 0.05));
        let moved = place(&turned, point) - before;
        assert!(moved.x > 0.1 && moved.y > 0.05, "{moved}");
        let mut panned = start();
        let target = panned.target;
        let before = place(&panned, target);
        panned.pan(Vec2::new(7.0, -3.0), lens().focal);
        let moved = place(&panned, target) - before;
        assert!((moved - Vec2::new(7.0, -3.0)).length() < 1e-3, "{moved}");
    }

    #[test]
    fn panning_keeps_distance_and_direction() {
        let mut viewpoint = start();
        for i in 0..1000 {
            viewpoint.pan(Vec2::new((i as f32).sin(), (i as f32).cos()) * 30.0, lens().focal);
        }
        assert_eq!(viewpoint.distance, start().distance);
        assert_eq!(viewpoint.axes(), start().axes());
        assert!((viewpoint.eye().distance(viewpoint.target) - start().distance).abs() < 1e-3);
    }

    #[test]
    fn the_horizon_stays_level() {
        let mut viewpoint = start();
        for i in 0..20_000 {
            let t = i as f32;
            let angles = 0.3 * Vec2::new((1.7 * t).sin(), (0.9 * t).cos());
            match i % 4 {
                0 => viewpoint.orbit(angles),
                1 => viewpoint.look(angles),
                2 => viewpoint.pan(angles, lens().focal),
                _ => viewpoint.walk(0.1 * angles.extend(t.cos())),
            }
            // The right of the picture is level.
            assert!(viewpoint.axes().right.dot(viewpoint.horizon.up).abs() < 1e-5, "{i}");
            assert!(viewpoint.axes().down.dot(viewpoint.horizon.up) < 1e-5, "{i}: upside down");
        }
    }

    #[test]
    fn looking_around_keeps_the_eye() {
        let mut viewpoint = start();
        let eye = viewpoint.eye();
        for i in 0..500 {
            viewpoint.look(Vec2::new(0.03, 0.01 * (i as f32).sin()));
        }
        assert!(viewpoint.eye().distance(eye) < 1e-3, "{}", viewpoint.eye());
        let mut right = start();
        right.look(Vec2::new(0.1, 0.0));
        assert!(right.axes().forward.dot(start().axes().right) > 0.05);
    }

    #[test]
    fn the_poles_can_be_reached_and_left() {
        for down in [1.0, -1.0] {
            let mut viewpoint = start();
            for _ in 0..100 {
                viewpoint.orbit(Vec2::new(0.0, 0.1 * down));
                viewpoint.camera(&lens()).validate().unwrap();
            }
            assert!((viewpoint.axes().forward.dot(viewpoint.horizon.up) + down).abs() < 1e-6, "straight down or up");
            // At a pole, a turn rotates the picture, and the way back is as long.
            let before = viewpoint.axes().right;
            viewpoint.orbit(Vec2::new(FRAC_PI_2, 0.0));
            assert!(viewpoint.axes().right.dot(before).abs() < 1e-5);
            viewpoint.orbit(Vec2::new(0.0, -0.1 * down));
            assert!(viewpoint.axes().forward.dot(viewpoint.horizon.up).abs() < 0.9999);
            let again = Viewpoint::of(&viewpoint.camera(&lens()), viewpoint.distance, Vec3::NEG_Y);
            assert!(close(&again.camera(&lens()), &viewpoint.camera(&lens()), 1e-4));
        }
        let nowhere = Viewpoint::of(&lens(), 1.0, Vec3::ZERO);
        assert!(close(&nowhere.camera(&lens()), &lens(), 1e-5), "without an up, -y is up");
    }
}
