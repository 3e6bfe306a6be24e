//! The interface of 2D and 3D scenes for a faulty backend.

use glam::{Vec2, Vec3};
use gs_conformance::subject::Subject;
use gs_core::{Camera, Canvas, Gaussian2d, Gaussian3d, Scene2d, Scene3d};

use super::Fault;

/// A kind of scene that a faulty backend can draw.
pub(crate) trait Fallible: Subject {
    /// The view after a fault.
    fn altered_view(fault: Fault, view: &Self::View) -> Self::View;

    /// A larger view that contains `view` in its first columns and rows, if the field of view
    /// matters.
    fn widened(view: &Self::View) -> Option<Self::View>;

    /// The Gaussian with its mean moved a little.
    fn shifted(gaussian: Self::Gaussian) -> Self::Gaussian;

    /// A Gaussian with all parameters 0.
    fn zero(&self) -> Self::Gaussian;
}

impl Fallible for Scene2d {
    fn altered_view(_: Fault, view: &Canvas) -> Canvas {
        *view
    }

    fn widened(_: &Canvas) -> Option<Canvas> {
        None
    }

    fn shifted(gaussian: Gaussian2d) -> Gaussian2d {
        Gaussian2d { mean: gaussian.mean + 1e-3, ..gaussian }
    }

    fn zero(&self) -> Gaussian2d {
        Gaussian2d { mean: Vec2::ZERO, log_scale: Vec2::ZERO, rotation: 0.0, opacity_logit: 0.0, color: Vec3::ZERO }
    }
}

impl Fallible for Scene3d {
    fn altered_view(fault: Fault, view: &Camera) -> Camera {
        let middle = Vec2::new(view.width as f32, view.height as f32) * 0.5;
        match fault {
            Fault::IgnoresTheNearPlane => Camera { near: f32::MIN_POSITIVE, ..*view },
            Fault::CentresThePrincipalPoint => Camera { center: middle, ..*view },
            Fault::SquaresPixels => Camera { focal: Vec2::splat(view.focal.x), ..*view },
            _ => *view,
        }
    }

    fn widened(view: &Camera) -> Option<Camera> {
        Some(Camera { width: 2 * view.width, height: 2 * view.height, ..*view })
    }

    fn shifted(gaussian: Gaussian3d) -> Gaussian3d {
        Gaussian3d { mean: gaussian.mean + 1e-3, ..gaussian }
    }

    fn zero(&self) -> Gaussian3d {
        Gaussian3d {
            mean: Vec3::ZERO,
            log_scale: Vec3::ZERO,
            rotation: [0.0; 4],
            opacity_logit: 0.0,
            sh: vec![Vec3::ZERO; self.sh_len()],
        }
    }
}
