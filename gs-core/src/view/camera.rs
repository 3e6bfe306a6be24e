//! Views of 3D scenes: posed pinhole cameras.

use glam::{DMat3, DQuat, Mat3, Vec2, Vec3};
use serde::{Deserialize, Serialize};

use crate::{constants::NEAR_WORLD, error::Error, image::check_size};

/// A posed pinhole camera; its axes are right, down, forward (OpenCV, COLMAP).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// World-to-camera rotation W (paper eq. 4).
    pub rotation: Mat3,
    /// World-to-camera translation: x_camera = W x_world + t, world units.
    pub translation: Vec3,
    /// Focal lengths (fx, fy), px.
    pub focal: Vec2,
    /// Principal point (cx, cy), px from the top-left corner.
    pub center: Vec2,
    /// Columns of the image.
    pub width: u32,
    /// Rows of the image.
    pub height: u32,
    /// Near plane, world units: Gaussians whose mean is nearer are not drawn.
    pub near: f32,
}

impl Camera {
    /// A camera at the origin that looks along +z, with a central principal point and a horizontal
    /// field of view of `fov_x` rad.
    pub fn looking_forward(width: u32, height: u32, fov_x: f32) -> Self {
        let focal = 0.5 * width as f32 / (0.5 * fov_x).tan();
        Self {
            rotation: Mat3::IDENTITY,
            translation: Vec3::ZERO,
            focal: Vec2::splat(focal),
            center: Vec2::new(width as f32, height as f32) * 0.5,
            width,
            height,
            near: NEAR_WORLD,
        }
    }

    /// Returns this camera at `position` (world units), turned towards `target`, with `up` upwards
    /// in its image. `None` where the target is at the position, or straight up or down from it.
    ///
    /// ```
    /// use glam::{Vec2, Vec3};
    /// use gs_core::Camera;
    ///
    /// let lens = Camera::looking_forward(64, 48, 1.0);
    /// let camera = lens.looking_at(Vec3::new(0.0, -4.0, 2.0), Vec3::ZERO, Vec3::Z).unwrap();
    /// let (pixel, depth) = camera.project(Vec3::ZERO).unwrap();
    /// assert!(pixel.distance(Vec2::new(32.0, 24.0)) < 1e-3 && (depth - 20f32.sqrt()).abs() < 1e-5);
    /// ```
    pub fn looking_at(&self, position: Vec3, target: Vec3, up: Vec3) -> Option<Self> {
        let forward = (target - position).try_normalize()?;
        let right = forward.cross(up.try_normalize()?).try_normalize().filter(|_| {
            // The cross product of nearly parallel directions is rounding error.
            forward.cross(up.normalize()).length() > 1e-4
        })?;
        let rotation = Mat3::from_cols(right, forward.cross(right), forward).transpose();
        Some(Self { rotation, translation: -(rotation * position), ..*self })
    }

    /// Returns this camera moved by a twist: a point in camera coordinates is turned by `rotation`
    /// and then shifted by `translation`.
    ///
    /// `rotation` is an angle in radians times a unit axis, and `translation` is in world units,
    /// both along the camera's axes. A turn leaves the camera's rotation orthonormal up to rounding,
    /// so that any number of moves keeps a valid camera valid.
    ///
    /// [`CameraGradient`](super::CameraGradient) has the derivatives by these six numbers at 0.
    #[must_use]
    pub fn moved(&self, translation: Vec3, rotation: Vec3) -> Self {
        if rotation == Vec3::ZERO {
            return Self { translation: self.translation + translation, ..*self };
        }
        let turn = DMat3::from_quat(DQuat::from_scaled_axis(rotation.as_dvec3()));
        let turned = turn * self.rotation.as_dmat3();
        // Newton's step to the nearest orthonormal matrix.
        let rotation = turned * (1.5 * DMat3::IDENTITY - 0.5 * turned.transpose() * turned);
        let translation = turn * self.translation.as_dvec3() + translation.as_dvec3();
        Self { rotation: rotation.as_mat3(), translation: translation.as_vec3(), ..*self }
    }

    /// A world point in camera coordinates.
    #[inline]
    pub fn to_camera(&self, world: Vec3) -> Vec3 {
        self.rotation * world + self.translation
    }

    /// Position of the camera, −Wᵀ t, world units.
    pub fn position(&self) -> Vec3 {
        -(self.rotation.transpose() * self.translation)
    }

    /// Projects a world point: its place on the image, px (u = fx·x/z + cx; pixel centres are at
    /// j + ½), and its depth z. `None` nearer than the near plane.
    #[inline]
    pub fn project(&self, world: Vec3) -> Option<(Vec2, f32)> {
        let p = self.to_camera(world);
        (p.z >= self.near).then(|| (self.focal * p.truncate() / p.z + self.center, p.z))
    }

    /// Returns this camera with another image size. The field of view stays, and focal lengths and
    /// principal point are scaled.
    #[must_use]
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let by = Vec2::new(width as f32 / self.width as f32, height as f32 / self.height as f32);
        Self { focal: self.focal * by, center: self.center * by, width, height, ..*self }
    }

    /// Checks that the size is possible, the pose finite, the rotation a rotation, and focal
    /// lengths and near plane positive.
    ///
    /// # Errors
    /// [`Error::Size`] or [`Error::Setting`] naming the first fault.
    pub fn validate(&self) -> Result<(), Error> {
        check_size(self.width, self.height)?;
        let gram = self.rotation * self.rotation.transpose();
        if !gram.abs_diff_eq(Mat3::IDENTITY, 1e-3) || !self.translation.is_finite() {
            return Err(Error::setting("camera pose", self.rotation, "a rotation and a finite translation"));
        }
        // An orthonormal matrix has a determinant of 1 or of -1.
        if !(self.rotation.determinant() > 0.0) {
            return Err(Error::setting("camera pose", self.rotation, "a rotation and no reflection, of determinant 1"));
        }
        if !(self.focal.min_element() > 0.0) || !self.focal.is_finite() || !self.center.is_finite() {
            return Err(Error::setting("camera intrinsics", self.focal, "finite, with positive focal lengths"));
        }
        // Distances that are not normal numbers have no inverse.
        Error::within("near plane", self.near, f32::MIN_POSITIVE..=f32::MAX, "finite and at least 1.2e-38")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_ahead_falls_on_the_principal_point() {
        let camera = Camera::looking_forward(64, 48, 1.0);
        camera.validate().unwrap();
        assert_eq!(camera.project(Vec3::new(0.0, 0.0, 3.0)), Some((Vec2::new(32.0, 24.0), 3.0)));
        assert_eq!(camera.project(Vec3::new(0.0, 0.0, -3.0)), None);
    }

    #[test]
    fn a_camera_is_turned_towards_its_target_unless_that_is_no_direction() {
        let lens = Camera::looking_forward(64, 48, 1.0);
        let position = Vec3::new(1.0, 2.0, 3.0);
        let camera = lens.looking_at(position, Vec3::X, Vec3::Z).unwrap();
        camera.validate().unwrap();
        assert!(camera.position().distance(position) < 1e-5);
        let above = camera.project(Vec3::X + 0.1 * Vec3::Z).unwrap().0;
        assert!(above.y < 24.0 && (above.x - 32.0).abs() < 1e-3, "{above}");
        assert_eq!(lens.looking_at(position, position, Vec3::Z), None);
        assert_eq!(lens.looking_at(position, position + Vec3::Z, Vec3::Z), None);
    }

    #[test]
    fn a_move_is_the_exponential_of_its_twist() {
        let camera = Camera::looking_forward(64, 48, 1.0);
        let camera = camera.looking_at(Vec3::new(1.0, 2.0, 3.0), Vec3::X, Vec3::Z).unwrap();
        let point = Vec3::new(0.3, -0.2, 0.9);
        let (by, axis, angle) = (Vec3::new(0.1, 0.2, -0.3), Vec3::new(2.0, -1.0, 2.0) / 3.0, 2.5);
        let expected = Mat3::from_axis_angle(axis, angle) * camera.to_camera(point) + by;
        assert!(camera.moved(by, axis * angle).to_camera(point).distance(expected) < 1e-5);
        assert_eq!(camera.moved(by, Vec3::ZERO).rotation, camera.rotation);
        // Half of the turn twice; the translation of the first half is turned by the second.
        let halves = camera.moved(by, 0.5 * angle * axis).moved(by, 0.5 * angle * axis);
        let turned = Mat3::from_axis_angle(axis, 0.5 * angle) * by;
        assert!(halves.to_camera(point).distance(expected + turned) < 1e-5);
    }

    #[test]
    fn many_moves_keep_a_camera_valid() {
        let mut camera = Camera::looking_forward(64, 48, 1.0);
        for i in 0..20_000u32 {
            let twist = |k: u32| 0.01 * ((i * 7 + k) as f32).sin();
            camera = camera.moved(Vec3::ZERO, Vec3::new(twist(0), twist(1), twist(2)));
        }
        let error = camera.rotation * camera.rotation.transpose();
        assert!(error.abs_diff_eq(Mat3::IDENTITY, 1e-6), "{error}");
        // As crooked as `validate` lets pass.
        camera.rotation *= 1.0004;
        camera.validate().unwrap();
        let straight = camera.moved(Vec3::ZERO, 1e-3 * Vec3::X).rotation;
        assert!((straight * straight.transpose()).abs_diff_eq(Mat3::IDENTITY, 2e-6), "{straight}");
    }

    #[test]
    fn a_mirrored_pose_is_refused() {
        let camera = Camera::looking_forward(64, 48, 1.0);
        for mirror in [Vec3::new(-1.0, 1.0, 1.0), Vec3::new(1.0, -1.0, 1.0), Vec3::NEG_ONE] {
            let error = Camera { rotation: Mat3::from_diagonal(mirror), ..camera }.validate().unwrap_err().to_string();
            assert!(error.contains("reflection"), "{error}");
        }
        let turned = Camera { rotation: Mat3::from_diagonal(Vec3::new(-1.0, -1.0, 1.0)), ..camera };
        assert_eq!(turned.validate(), Ok(()));
    }

    #[test]
    fn a_resized_camera_sees_the_same() {
        let camera = Camera::looking_forward(40, 30, 1.0);
        let point = Vec3::new(0.2, 0.1, 1.0);
        let (small, _) = camera.project(point).unwrap();
        let (large, _) = camera.resized(80, 90).project(point).unwrap();
        assert!((large - small * Vec2::new(2.0, 3.0)).length() < 1e-4);
    }
}
