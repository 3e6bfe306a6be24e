//! The splitting matrix of a Gaussian in one view, from the gradient of its parameters.
//!
//! With t = α ∂L/∂α of a pixel at d from the mean, and Q = K⁻¹ the matrix of the exponent, a
//! displacement of the mean by x px changes α to second order by α xᵀ (Q d dᵀ Q − Q) x / 2. The
//! matrix in the image is therefore Σ t (Q d dᵀ Q − Q) = 2 ∂L/∂K − (Σ t) Q, and Σ t = ∂L/∂(ln o).
//! The linearised projection M′ carries it into units of the Gaussian's standard deviations.
//!
//! Legend: that of [`perspective`](super), with ω the turn about the Gaussian's own axes.

use glam::{Mat3, Vec3};

use super::{Ellipsoid, Intermediate, Perspective, Quaternion, turned};
#[cfg(doc)]
use crate::effects::Blend;
use crate::scene::sigmoid;

/// Least difference of the ln-scales of a Gaussian for [`Perspective::splitting_matrix`].
pub const LEAST_LOG_RATIO: f32 = 0.01;

impl Ellipsoid {
    /// This Gaussian with ln-scales that differ by at least [`LEAST_LOG_RATIO`] from each other.
    /// They change by at most that much.
    #[must_use]
    pub fn without_equal_scales(self) -> Self {
        let mut order = [0, 1, 2];
        order.sort_unstable_by(|&i, &j| self.log_scale[i].total_cmp(&self.log_scale[j]));
        let [least, middle, most] = order;
        let mut log_scale = self.log_scale;
        log_scale[least] = log_scale[least].min(log_scale[middle] - LEAST_LOG_RATIO);
        log_scale[most] = log_scale[most].max(log_scale[middle] + LEAST_LOG_RATIO);
        Self { log_scale, ..self }
    }
}

impl Perspective {
    /// The splitting matrix S of a Gaussian that [`Self::project`] accepts, in units of its
    /// standard deviations along its axes: xx, xy, xz, yy, yz, zz. `v` is the gradient by its
    /// parameters.
    ///
    /// Two Gaussians of half the opacity, displaced by x and −x standard deviations, change the
    /// loss by ½ xᵀ S x, to second order in x and first order in the opacity (*source:* Wang et al.
    /// 2025, arXiv 2505.05587; the projection is linearised). For [`Blend::Over`]. The gradient by
    /// the rotation vanishes for equal scales, so scales must not be nearly equal: see
    /// [`Ellipsoid::without_equal_scales`]. `None` where the opacity is 1.
    pub fn splitting_matrix(&self, g: &Ellipsoid, v: &Ellipsoid) -> Option<[f32; 6]> {
        let by_log_opacity = v.opacity_logit / sigmoid(-g.opacity_logit);
        if !by_log_opacity.is_finite() {
            return None;
        }
        let rotation = turned(&Quaternion::new(g.rotation)).rotation;
        let p = self.rotation * g.mean + self.translation;
        let rows = self.rows(&rotation, g.log_scale);
        let Intermediate { projected: [r0, r1], .. } = self.intermediate(p, &rows);
        // v_ω of a turn about the Gaussian's axes: dq = ½ q (0, ω).
        let ([w, x, y, z], [v_w, v_x, v_y, v_z]) = (g.rotation, v.rotation);
        let (axis, v_axis) = (Vec3::new(x, y, z), Vec3::new(v_x, v_y, v_z));
        let turn = 0.5 * (w * v_axis - v_w * axis + v_axis.cross(axis));
        // 2 V, with V = ∂L/∂Σ in standard deviations: the gradient by a ln-scale is 2 V_kk, and
        // that by a turn in the plane of i and j is 2 V_ij (s_i/s_j − s_j/s_i).
        let off_diagonal = |i: usize, j: usize, v_turn: f32| v_turn / (2.0 * (g.log_scale[i] - g.log_scale[j]).sinh());
        let (xy, xz, yz) = (off_diagonal(0, 1, turn.z), -off_diagonal(0, 2, turn.y), off_diagonal(1, 2, turn.x));
        let diagonal = v.log_scale;
        let twice = Mat3::from_cols(
            Vec3::new(diagonal.x, xy, xz),
            Vec3::new(xy, diagonal.y, yz),
            Vec3::new(xz, yz, diagonal.z),
        );
        let s = twice - by_log_opacity * self.exponent_of(r0, r1);
        s.is_finite().then_some([s.x_axis.x, s.y_axis.x, s.z_axis.x, s.y_axis.y, s.z_axis.y, s.z_axis.z])
    }

    /// M′ᵀ K⁻¹ M′. Where the opacity compensates, its gradient by Σ is part of that by the scales;
    /// K is then Σ before antialiasing, which takes that part out again.
    fn exponent_of(&self, r0: Vec3, r1: Vec3) -> Mat3 {
        let delta = if self.antialias.compensates() { 0.0 } else { self.dilation };
        let (xx, xy, yy) = (r0.length_squared() + delta, r0.dot(r1), r1.length_squared() + delta);
        let trace = r0.length_squared() + r1.length_squared();
        let determinant = r0.cross(r1).length_squared() + delta * trace + delta * delta;
        let outer = |a: Vec3, b: Vec3| Mat3::from_cols(a * b.x, a * b.y, a * b.z);
        (yy * outer(r0, r0) - xy * (outer(r0, r1) + outer(r1, r0)) + xx * outer(r1, r1)) * (1.0 / determinant)
    }
}
