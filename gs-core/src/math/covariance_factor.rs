//! [`Parameterization::CovarianceFactor`](crate::Parameterization::CovarianceFactor) of 3D
//! Gaussians: steps in a Gaussian's own coordinates.
//!
//! The shape is held as a factor M with Σ = M Mᵀ, for example M = R(q) S. A step is μ ← μ + M ξ, M
//! ← M (I + η + η²/2) with η symmetric: an antisymmetric part would turn the factor without
//! changing Σ. ξ and η have no unit, so a learning rate is the same fraction of every Gaussian's
//! extent, along each of its axes. ∂L/∂ξ = Mᵀ ∂L/∂μ, and ∂L/∂η = 2 Mᵀ (∂L/∂Σ) M.
//!
//! A quaternion without direction has no factor: such a Gaussian has a factor of zeros, is not
//! drawn, and is downloaded with a quaternion of zeros.
//!
//! Symmetric matrices are six numbers: (00, 01, 02, 11, 12, 22). As gradients, those off the
//! diagonal are derivatives by each of the two equal entries.

use glam::{DMat3, DQuat, DVec3, Mat3, Quat, Vec3};

use crate::{
    adam::AdamRates,
    constants::{MAX_ETA, MIN_QUATERNION_NORM2},
    math::perspective::{Quaternion, quaternion_vjp},
    scene::Gaussian3d,
};

/// A symmetric 3×3 matrix: 00, 01, 02, 11, 12, 22.
pub type Symmetric3 = [f32; 6];

/// Parameters of a 3D Gaussian in this parameterization, without its colour.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Factored {
    /// μ, world units.
    pub mean: Vec3,
    /// M with Σ = M Mᵀ, world units.
    pub factor: Mat3,
    /// Logit of the opacity.
    pub opacity_logit: f32,
}

/// ∂L/∂ each field of a [`Factored`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FactoredGradient {
    /// ∂L/∂μ, per world unit; ∂L/∂ξ is Mᵀ times this.
    pub mean: Vec3,
    /// ∂L/∂η.
    pub stretch: Symmetric3,
    /// ∂L/∂(opacity logit).
    pub opacity_logit: f32,
}

/// Singular value decomposition of a factor, M = U S Vᵀ with U a rotation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PrincipalAxes {
    /// U: the ellipsoid's axes in the world.
    pub axes: DMat3,
    /// S: the scales along the axes, world units, not negative.
    pub scales: DVec3,
    /// V: the axes in the factor's own coordinates; a rotation, or a rotation with a reflection.
    pub turn: DMat3,
}

/// Sweeps of the Jacobi method; it converges quadratically, and 3×3 matrices need four to six.
const SWEEPS: usize = 16;

/// Smallest scale in a factor, world units, so that a factor of a Gaussian with a direction keeps
/// its axes. Its square is 0.
const LEAST_SCALE: f32 = 1e-30;

/// Columns whose cosine is below this are orthogonal.
const ORTHOGONAL: f64 = 1e-15;

impl PrincipalAxes {
    /// The axes of a factor, in the order of its columns where these are orthogonal and of
    /// different lengths. NaN stays NaN.
    ///
    /// One-sided Jacobi (Hestenes 1958) in `f64`: each scale is accurate to its own last digits,
    /// however thin the ellipsoid.
    pub fn of(factor: Mat3) -> Self {
        Self::of_exact(factor.as_dmat3())
    }

    fn of_exact(factor: DMat3) -> Self {
        let mut columns = [factor.x_axis, factor.y_axis, factor.z_axis];
        let mut turn = [DVec3::X, DVec3::Y, DVec3::Z];
        for _ in 0..SWEEPS {
            let mut orthogonal = true;
            for (i, j) in [(0, 1), (0, 2), (1, 2)] {
                let (a, b) = (columns[i], columns[j]);
                let (aa, bb, ab) = (a.length_squared(), b.length_squared(), a.dot(b));
                if ab.abs() > ORTHOGONAL * (aa * bb).sqrt() {
                    orthogonal = false;
                    let half = (bb - aa) / (2.0 * ab);
                    let tangent = 1f64.copysign(half) / (half.abs() + (1.0 + half * half).sqrt());
                    let cosine = 1.0 / (1.0 + tangent * tangent).sqrt();
                    let sine = cosine * tangent;
                    for pair in [&mut columns, &mut turn] {
                        (pair[i], pair[j]) = (pair[i] * cosine - pair[j] * sine, pair[i] * sine + pair[j] * cosine);
                    }
                }
            }
            if orthogonal {
                break;
            }
        }
        let scales = DVec3::from_array(columns.map(DVec3::length));
        let mut axes = completed(columns, scales);
        if axes.determinant() < 0.0 {
            axes.z_axis = -axes.z_axis;
            turn[2] = -turn[2];
        }
        Self { axes, scales, turn: DMat3::from_cols(turn[0], turn[1], turn[2]) }
    }

    /// ln-scales, ln(world units), and the rotation as a quaternion (w, x, y, z) of length 1.
    pub fn shape(&self) -> (Vec3, [f32; 4]) {
        let q = DQuat::from_mat3(&self.axes);
        (self.scales.map(f64::ln).as_vec3(), [q.w, q.x, q.y, q.z].map(|c| c as f32))
    }
}

/// Orthogonal columns scaled to length 1; columns of length 0 are replaced by ones orthogonal to
/// the others.
fn completed(columns: [DVec3; 3], scales: DVec3) -> DMat3 {
    let mut axes: [Option<DVec3>; 3] = std::array::from_fn(|k| (scales[k] != 0.0).then(|| columns[k] / scales[k]));
    for k in 0..3 {
        let across = match (axes[(k + 1) % 3], axes[(k + 2) % 3]) {
            (Some(a), Some(b)) => a.cross(b),
            (Some(a), None) | (None, Some(a)) => a.any_orthonormal_vector(),
            (None, None) => DVec3::AXES[k],
        };
        axes[k].get_or_insert(across);
    }
    let [x, y, z] = axes.map(Option::unwrap_or_default);
    DMat3::from_cols(x, y, z)
}

/// R(q/|q|) S: a factor of Σ (paper eq. 5), world units, never of zeros. `None` where q is too
/// short to have a direction ([`MIN_QUATERNION_NORM2`]).
pub fn factor_of(log_scale: Vec3, rotation: [f32; 4]) -> Option<Mat3> {
    let Quaternion { scaled: [w, x, y, z], norm2, .. } = Quaternion::new(rotation);
    if !(norm2 >= MIN_QUATERNION_NORM2) {
        return None;
    }
    // NaN stays, so that the Gaussian is pruned.
    let scales = log_scale.map(f32::exp).map(|scale| if scale < LEAST_SCALE { LEAST_SCALE } else { scale });
    Some(Mat3::from_quat(Quat::from_xyzw(x, y, z, w).normalize()) * Mat3::from_diagonal(scales))
}

/// The factor M Q of the same Σ, with Q orthogonal, that is nearest to `parent`, so that moments of
/// `parent` keep their meaning. `factor` itself where one of the two is not finite.
///
/// Q is the orthogonal factor of the polar decomposition of Mᵀ `parent` (the orthogonal Procrustes
/// problem, Schönemann 1966).
#[must_use]
pub fn aligned(factor: Mat3, parent: Mat3) -> Mat3 {
    if !(factor.is_finite() && parent.is_finite()) {
        return factor;
    }
    let wide = factor.as_dmat3();
    let PrincipalAxes { axes, turn, .. } = PrincipalAxes::of_exact(wide.transpose() * parent.as_dmat3());
    (wide * axes * turn.transpose()).as_mat3()
}

impl Gaussian3d {
    /// ln-scales and rotation (a quaternion of length 1) of Σ = M Mᵀ.
    ///
    /// The scales are in the order of M's columns where these are orthogonal and of different
    /// lengths; an axis without extent has the scale ln 0. A factor of zeros has a quaternion of
    /// zeros and scales too small to be drawn.
    pub fn shape_of_factor(m: Mat3) -> (Vec3, [f32; 4]) {
        if m == Mat3::ZERO {
            return (Vec3::splat(LEAST_SCALE.ln()), [0.0; 4]);
        }
        PrincipalAxes::of(m).shape()
    }
}

/// One step: M (I + η + η²/2), with each entry of η clamped to ±[`MAX_ETA`] and the scales clamped
/// to the bounds of `rates`.
///
/// A factor that is not finite stays so, so that the Gaussian is pruned. A factor of zeros stays,
/// too.
#[inline]
pub fn stretched(factor: Mat3, eta: Symmetric3, rates: &AdamRates) -> Mat3 {
    let eta = symmetric(eta.map(|entry| entry.clamp(-MAX_ETA, MAX_ETA)));
    let m = factor + factor * (eta + eta * eta * 0.5);
    // The largest scale is at most the Frobenius norm of M, and the inverse of the smallest that of
    // M⁻¹ = (cofactors of M)ᵀ/|M|.
    let cofactors = Mat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis));
    let determinant = m.x_axis.dot(cofactors.x_axis);
    let suspicious = determinant.abs() <= rates.min_scale * frobenius(&cofactors) || frobenius(&m) > rates.max_scale;
    if suspicious { bounded(m, rates) } else { m }
}

/// M with its scales clamped to their bounds.
#[cold]
fn bounded(m: Mat3, rates: &AdamRates) -> Mat3 {
    let PrincipalAxes { axes, scales, turn } = PrincipalAxes::of(m);
    let within = scales.clamp(DVec3::splat(rates.min_scale.into()), DVec3::splat(rates.max_scale.into()));
    if within == scales || !scales.is_finite() || m == Mat3::ZERO {
        return m;
    }
    (axes * DMat3::from_diagonal(within) * turn.transpose()).as_mat3()
}

/// ∂(sum of the three scales)/∂η: V S Vᵀ for M = U S Vᵀ.
pub fn sum_of_scales_vjp(factor: Mat3) -> Symmetric3 {
    let PrincipalAxes { scales, turn, .. } = PrincipalAxes::of(factor);
    entries(&(turn * DMat3::from_diagonal(scales) * turn.transpose()))
}

/// Converts a gradient by η to one by the ln-scales and the quaternion of
/// [`Gaussian3d::shape_of_factor`].
///
/// From V, η is Vᵀ η V. Its diagonal is the change of the ln-scales; a turn ω about the third axis
/// makes its entries 01 and 10 change by ω s₀/s₁ and −ω s₁/s₀, whence v_ω = 2 sinh(ln s₀ − ln s₁)
/// v₀₁; and so on.
pub fn by_scale_rotation(factor: Mat3, stretch: Symmetric3) -> (Vec3, [f32; 4]) {
    let principal = PrincipalAxes::of(factor);
    let (log_scale, rotation) = Gaussian3d::shape_of_factor(factor);
    let turn = principal.turn;
    let v = turn.transpose() * symmetric(stretch).as_dmat3() * turn;
    let [a, b, c] = log_scale.as_dvec3().to_array();
    // Turning two axes of which one has no extent (ln 0) changes nothing.
    let about = |v: f64, log_ratio: f64| {
        let turned = 2.0 * v * log_ratio.sinh();
        if turned.is_finite() { turned } else { 0.0 }
    };
    let v_turn = DVec3::new(about(v.y_axis.z, b - c), about(v.z_axis.x, c - a), about(v.x_axis.y, a - b));
    let v_turn = principal.axes * v_turn;
    let v_log_scale = DVec3::new(v.x_axis.x, v.y_axis.y, v.z_axis.z);
    (v_log_scale.as_vec3(), quaternion_vjp(rotation, 1.0, v_turn.as_vec3()))
}

fn symmetric([a, b, c, d, e, f]: Symmetric3) -> Mat3 {
    Mat3::from_cols(Vec3::new(a, b, c), Vec3::new(b, d, e), Vec3::new(c, e, f))
}

fn entries(m: &DMat3) -> Symmetric3 {
    [m.x_axis.x, m.x_axis.y, m.x_axis.z, m.y_axis.y, m.y_axis.z, m.z_axis.z].map(|entry| entry as f32)
}

fn frobenius(m: &Mat3) -> f32 {
    (m.x_axis.length_squared() + m.y_axis.length_squared() + m.z_axis.length_squared()).sqrt()
}

#[cfg(test)]
mod tests;
