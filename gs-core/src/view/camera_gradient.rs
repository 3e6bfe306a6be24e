//! The gradient of a loss by the camera.

use std::ops::Add;

use glam::{Vec2, Vec3};

use crate::error::Error;

/// ∂L/∂ the pose and the intrinsics of a [`Camera`](super::Camera), at the camera as it is.
///
/// The pose is moved by a twist (v, ω) on the left of the world-to-camera pose: a point p in camera
/// coordinates goes to exp(ω×) p + v, as by [`Camera::moved`](super::Camera::moved). The derivatives
/// are by the twist at 0.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CameraGradient {
    /// ∂L/∂v along the camera's axes, per world unit.
    pub translation: Vec3,
    /// ∂L/∂ω about the camera's axes, per radian.
    pub rotation: Vec3,
    /// ∂L/∂(fx, fy), per px.
    pub focal: Vec2,
    /// ∂L/∂(cx, cy), per px.
    pub center: Vec2,
}

impl CameraGradient {
    /// The ten numbers: those of the translation, the rotation, the focal length and the principal
    /// point.
    pub fn to_array(self) -> [f32; 10] {
        let ([a, b, c], [d, e, f]) = (self.translation.to_array(), self.rotation.to_array());
        [a, b, c, d, e, f, self.focal.x, self.focal.y, self.center.x, self.center.y]
    }

    /// The gradient of the ten numbers that [`Self::to_array`] returns.
    pub fn from_array([a, b, c, d, e, f, g, h, i, j]: [f32; 10]) -> Self {
        Self {
            translation: Vec3::new(a, b, c),
            rotation: Vec3::new(d, e, f),
            focal: Vec2::new(g, h),
            center: Vec2::new(i, j),
        }
    }

    /// The error of [`Rasterizer::camera_gradient`](crate::Rasterizer::camera_gradient) for a
    /// forward pass that did not ask for the gradient.
    pub fn not_requested() -> Error {
        Error::State(
            "there is no gradient by the camera, because the forward pass did not ask for it by \
             RenderSettings::camera_gradient"
                .to_owned(),
        )
    }
}

impl Add for CameraGradient {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            translation: self.translation + other.translation,
            rotation: self.rotation + other.rotation,
            focal: self.focal + other.focal,
            center: self.center + other.center,
        }
    }
}
