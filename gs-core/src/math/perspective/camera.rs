//! The gradient by the camera through one Gaussian, with the legend of `perspective`.

use glam::{Vec2, Vec3};

use super::{Ellipsoid, Intermediate, Perspective, ProjectionGradient, Quaternion, Returned, turn_vjp, turned};
use crate::view::CameraGradient;

impl Perspective {
    /// ∂L/∂ the camera through a Gaussian that [`Self::project`] accepts, without the part through
    /// its colour.
    ///
    /// A twist (v, ω) moves p by v + ω × p and turns M by ω. The bounds of a clamped slope, −c/f −
    /// margin and (size − c)/f + margin, are proportional to 1/f, because the margin is.
    pub fn camera_vjp(&self, g: &Ellipsoid, v: &ProjectionGradient) -> CameraGradient {
        let p = self.rotation * g.mean + self.translation;
        let rows = self.rows(&turned(&Quaternion::new(g.rotation)).rotation, g.log_scale);
        let Intermediate { slope, clamped, .. } = self.intermediate(p, &rows);
        let Returned { v_p, projected: [r0, r1], v_projected: [v_r0, v_r1], v_rows, .. } =
            self.project_rows_vjp(p, &rows, g.opacity_logit, v);
        let v_clamped = -Vec2::new(v_rows[0].dot(rows[2]), v_rows[1].dot(rows[2]));
        let v_bound = Vec2::select(slope.cmpeq(clamped), Vec2::ZERO, v_clamped);
        CameraGradient {
            translation: v_p,
            rotation: p.cross(v_p) + turn_vjp(&rows, &v_rows),
            focal: v.mean * slope + (Vec2::new(v_r0.dot(r0), v_r1.dot(r1)) - v_bound * clamped) / self.focal,
            center: v.mean - v_bound / self.focal,
        }
    }

    /// ∂L/∂ the camera through [`Self::direction`], from `v_mean` by [`Self::direction_vjp`].
    ///
    /// A turn of the camera about its own place changes no direction in the world.
    pub fn direction_camera_vjp(&self, v_mean: Vec3) -> CameraGradient {
        CameraGradient { translation: self.rotation * v_mean, ..CameraGradient::default() }
    }

    /// ∂L/∂ the camera through the inverse depth of a mean, from `v_mean` by
    /// [`Self::inverse_depth_vjp`].
    pub fn inverse_depth_camera_vjp(&self, mean: Vec3, v_mean: Vec3) -> CameraGradient {
        let v_p = self.rotation * v_mean;
        let p = self.rotation * mean + self.translation;
        CameraGradient { translation: v_p, rotation: p.cross(v_p), ..CameraGradient::default() }
    }
}
