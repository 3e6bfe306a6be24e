//! Gradients in the whitened coordinates of a 2D Gaussian, and their conversion to other
//! parameters.
//!
//! With Σ = L Lᵀ, a step μ += L ξ, L ← L exp(η) with symmetric η is a step in the Gaussian's own
//! coordinates. The gradients by ξ and η are sums of moments over the pixels, so a backend computes
//! them first, in either parameterization.

use glam::{Mat2, Vec2};

use crate::scene::Gaussian2d;

/// ∂L/∂(ξ, η) of one 2D Gaussian.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct WhitenedGradient {
    /// ∂L/∂ξ.
    pub xi: Vec2,
    /// ∂L/∂η₀₀; ∂L/∂η₀₁ (the same for η₁₀); ∂L/∂η₁₁.
    pub eta: [f32; 3],
}

impl WhitenedGradient {
    /// ∂L/∂mean (px⁻¹), and ∂L/∂(two ln-scales, rotation in rad), for a factor L = R(θ) S in which
    /// this gradient is.
    ///
    /// `log_ratio` is the first ln-scale less the second; computed from L, it would lose its digits
    /// where a Gaussian is nearly round.
    pub fn by_scale_rotation(&self, l: Mat2, log_ratio: f32) -> (Vec2, [f32; 3]) {
        let [e_00, e_01, e_11] = self.eta;
        (solve_transposed(l, self.xi), [e_00, e_11, e_01 * 2.0 * log_ratio.sinh()])
    }

    /// The factor R(θ) S of the same Σ as `l`, its first ln-scale less the second, and the gradient
    /// in that factor.
    pub fn in_axes(&self, l: Mat2) -> (Mat2, f32, Self) {
        let (log_scale, angle) = Gaussian2d::shape_of_factor(l);
        let (sin, cos) = angle.sin_cos();
        let axes = Mat2::from_cols(Vec2::new(cos, sin) * log_scale.x.exp(), Vec2::new(-sin, cos) * log_scale.y.exp());
        // z_axes = axes⁻¹ L z, a rotation (or reflection) of z.
        let q = axes.inverse() * l;
        let [e_00, e_01, e_11] = self.eta;
        let moment = q * Mat2::from_cols_array(&[e_00, e_01, e_01, e_11]) * q.transpose();
        let turned = Self { xi: q * self.xi, eta: [moment.x_axis.x, moment.x_axis.y, moment.y_axis.y] };
        (axes, log_scale.x - log_scale.y, turned)
    }
}

/// The factor L Q of the same Σ, with Q a rotation or a reflection, that is nearest to `parent`, so
/// that moments of `parent` keep their meaning. `factor` itself where one of the two is not finite
/// or 0.
///
/// Q maximises the trace of Qᵀ Lᵀ `parent` (the orthogonal Procrustes problem, Schönemann 1966).
#[must_use]
pub fn aligned(factor: Mat2, parent: Mat2) -> Mat2 {
    let a = factor.transpose() * parent;
    let side = if a.determinant() < 0.0 { -1.0 } else { 1.0 };
    let first = Vec2::new(a.x_axis.x + side * a.y_axis.y, a.x_axis.y - side * a.y_axis.x);
    let length = first.length();
    if !(length > 0.0 && length.is_finite()) {
        return factor;
    }
    let first = first / length;
    factor * Mat2::from_cols(first, side * first.perp())
}

/// L⁻ᵀ v; 0 where L is singular, which a dilated Gaussian's may be.
pub fn solve_transposed(l: Mat2, v: Vec2) -> Vec2 {
    let inverse = 1.0 / l.determinant();
    if inverse.is_infinite() {
        return Vec2::ZERO;
    }
    Vec2::new(l.y_axis.y * v.x - l.x_axis.y * v.y, l.x_axis.x * v.y - l.y_axis.x * v.x) * inverse
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_aligned_factor_keeps_the_covariance_and_is_the_parents_if_possible() {
        let parent = Mat2::from_angle(0.4) * Mat2::from_diagonal(Vec2::new(3.0, 0.2)) * Mat2::from_angle(2.1);
        for mirror in [1.0, -1.0] {
            let other = parent * Mat2::from_angle(-1.3) * Mat2::from_diagonal(Vec2::new(1.0, mirror));
            assert!(aligned(other, parent).abs_diff_eq(parent, 1e-5), "{mirror}");
            let wider = Mat2::from_diagonal(Vec2::new(1.5, 0.9)) * other;
            let found = aligned(wider, parent);
            let [before, after] = [wider, found].map(|l| l * l.transpose());
            assert!(after.abs_diff_eq(before, 1e-4), "{mirror}");
            assert!(distance(found, parent) < distance(wider, parent));
        }
        assert_eq!(aligned(parent, Mat2::ZERO), parent);
        assert_eq!(aligned(parent, Mat2::NAN), parent);
    }

    fn distance(a: Mat2, b: Mat2) -> f32 {
        let d = a - b;
        d.x_axis.length_squared() + d.y_axis.length_squared()
    }

    #[test]
    fn the_same_gradient_in_another_factor_of_the_same_covariance() {
        let axes = Mat2::from_angle(0.4) * Mat2::from_diagonal(Vec2::new(3.0, 0.7));
        let gradient = WhitenedGradient { xi: Vec2::new(0.3, -0.8), eta: [0.2, -0.5, 0.9] };
        let (expected_mean, expected_shape) = gradient.by_scale_rotation(axes, (3.0f32 / 0.7).ln());
        // z = axes⁻¹ d = V l⁻¹ d for l = axes V: seen from l, the gradient is turned back by V.
        let v = Mat2::from_angle(-1.1);
        let [a, b, c] = gradient.eta;
        let turned = v.transpose() * Mat2::from_cols_array(&[a, b, b, c]) * v;
        let eta = [turned.x_axis.x, turned.x_axis.y, turned.y_axis.y];
        let (found_axes, log_ratio, found) =
            WhitenedGradient { xi: v.transpose() * gradient.xi, eta }.in_axes(axes * v);
        let (mean, shape) = found.by_scale_rotation(found_axes, log_ratio);
        assert!((mean - expected_mean).length() < 1e-5, "{mean} {expected_mean}");
        for k in 0..3 {
            assert!((shape[k] - expected_shape[k]).abs() < 1e-4, "{shape:?} {expected_shape:?}");
        }
    }
}
