//! A Gaussian at a pixel: `weight`, `blend_fwd`, `blend_bwd`. The reference for every backend's
//! kernels, written for clarity, not speed.
//!
//! Legend: d = pixel centre − mean (px), w = weight, o = opacity, α = min(o·w, α_max), T =
//! transmittance before this Gaussian, `v_x` = ∂L/∂x.

use glam::{Mat2, Vec2};

use crate::{
    constants::MIN_DETERMINANT_PX4,
    settings::{Accuracy, Cut},
};

/// Σ′⁻¹ of a projected Gaussian, symmetric: (a, b; b, c), px⁻².
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Conic {
    /// Coefficient of dx².
    pub a: f32,
    /// Half the coefficient of dx·dy.
    pub b: f32,
    /// Coefficient of dy².
    pub c: f32,
}

impl Conic {
    /// The inverse of Σ′ = L Lᵀ (px²) from L (px), whose determinant suffers no cancellation;
    /// `None` where det Σ′ is not at least [`MIN_DETERMINANT_PX4`], or not finite.
    pub fn of_factor(l: Mat2) -> Option<Self> {
        let det = l.determinant();
        if !(det * det >= MIN_DETERMINANT_PX4) || !(det * det).is_finite() {
            return None;
        }
        let inverse = 1.0 / det;
        // Rows of L⁻¹ are (z, −x) of the columns; Σ′⁻¹ = L⁻ᵀ L⁻¹.
        let (p, q) = (l.x_axis * inverse, l.y_axis * inverse);
        let conic = Self { a: q.y * q.y + p.y * p.y, b: -(q.x * q.y + p.x * p.y), c: q.x * q.x + p.x * p.x };
        (conic.a.is_finite() && conic.b.is_finite() && conic.c.is_finite()).then_some(conic)
    }

    /// σ = ½ dᵀ Σ′⁻¹ d.
    pub fn sigma(&self, d: Vec2) -> f32 {
        0.5 * (self.a * d.x * d.x + self.c * d.y * d.y) + self.b * d.x * d.y
    }
}

/// w = exp(−½ dᵀ Σ′⁻¹ d) (paper eq. 3); 0 where rounding has made the conic indefinite or σ is NaN.
pub fn weight(conic: &Conic, d: Vec2) -> f32 {
    let sigma = conic.sigma(d);
    if sigma >= 0.0 { (-sigma).exp() } else { 0.0 }
}

/// The cut: 0 where `value` (w under `Sum`, o·w under `Over`) is below [`Accuracy::alpha_cut`].
pub fn cut(value: f32, accuracy: &Accuracy) -> f32 {
    if accuracy.cut == Cut::Smooth || value >= accuracy.alpha_cut { value } else { 0.0 }
}

/// [`Blend::Sum`](crate::effects::Blend::Sum): C = Σ w c.
pub mod sum {
    /// Adds one Gaussian of (cut) weight `w`.
    pub fn blend_fwd(color: &mut [f32; 3], w: f32, c: [f32; 3]) {
        for k in 0..3 {
            color[k] += w * c[k];
        }
    }

    /// (v_w, v_c) of one Gaussian from v_C.
    pub fn blend_bwd(v_color: [f32; 3], w: f32, c: [f32; 3]) -> (f32, [f32; 3]) {
        ((0..3).map(|k| v_color[k] * c[k]).sum(), v_color.map(|v| v * w))
    }
}

/// [`Blend::Over`](crate::effects::Blend::Over): C = Σ T α c, front to back (paper eq. 2).
pub mod over {
    use crate::settings::Accuracy;

    /// State of a pixel while it is blended.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct Forward {
        /// Σ T α c so far.
        pub color: [f32; 3],
        /// T = Π (1 − α) so far.
        pub transmittance: f32,
        /// Whether T would have fallen below the minimum; no further Gaussian counts then.
        pub full: bool,
    }

    impl Default for Forward {
        fn default() -> Self {
            Self { color: [0.0; 3], transmittance: 1.0, full: false }
        }
    }

    /// α = min(o·w, α_max).
    pub fn alpha(opacity_times_weight: f32, accuracy: &Accuracy) -> f32 {
        opacity_times_weight.min(accuracy.alpha_max)
    }

    /// Blends a Gaussian behind the previous ones; returns whether it counted.
    pub fn blend_fwd(pixel: &mut Forward, alpha: f32, c: [f32; 3], accuracy: &Accuracy) -> bool {
        if pixel.full || !(alpha > 0.0) {
            return false;
        }
        let behind = pixel.transmittance * (1.0 - alpha);
        if behind < accuracy.transmittance_min {
            pixel.full = true;
            return false;
        }
        for k in 0..3 {
            pixel.color[k] += pixel.transmittance * alpha * c[k];
        }
        pixel.transmittance = behind;
        true
    }

    /// State of a pixel while it is replayed front to back for its gradients.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct Backward {
        /// v_C of the finished pixel.
        pub v_color: [f32; 3],
        /// v_C · (the part of the finished colour, background included, that is behind what was
        /// replayed so far).
        pub v_rest: f32,
        /// T so far.
        pub transmittance: f32,
        /// Whether the pixel is full ([`Forward::full`]).
        pub full: bool,
    }

    impl Backward {
        /// Starts the replay of a pixel whose finished colour, background included, is `color`.
        pub fn new(v_color: [f32; 3], color: [f32; 3]) -> Self {
            let v_rest = (0..3).map(|k| v_color[k] * color[k]).sum();
            Self { v_color, v_rest, transmittance: 1.0, full: false }
        }
    }

    /// (v_α, v_c) of the next Gaussian, `None` where it did not count. v_α = T c·v_C − rest/(1 −
    /// α), where 1 − α is at least 1 − α_max. Where α was clamped the caller must take v_(o·w) = 0.
    pub fn blend_bwd(pixel: &mut Backward, alpha: f32, c: [f32; 3], accuracy: &Accuracy) -> Option<(f32, [f32; 3])> {
        if pixel.full || !(alpha > 0.0) {
            return None;
        }
        let t = pixel.transmittance;
        let behind = t * (1.0 - alpha);
        if behind < accuracy.transmittance_min {
            pixel.full = true;
            return None;
        }
        let v_dot_c: f32 = (0..3).map(|k| pixel.v_color[k] * c[k]).sum();
        pixel.v_rest -= t * alpha * v_dot_c;
        pixel.transmittance = behind;
        Some((t * v_dot_c - pixel.v_rest / (1.0 - alpha), pixel.v_color.map(|v| v * t * alpha)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conic_of_factor_inverts_the_covariance() {
        let l = Mat2::from_cols(Vec2::new(3.0, 1.0), Vec2::new(-0.5, 2.0));
        let inverse = (l * l.transpose()).inverse();
        let conic = Conic::of_factor(l).unwrap();
        assert!((conic.a - inverse.x_axis.x).abs() < 1e-6);
        assert!((conic.b - inverse.x_axis.y).abs() < 1e-6);
        assert!((conic.c - inverse.y_axis.y).abs() < 1e-6);
        assert_eq!(Conic::of_factor(Mat2::from_cols(Vec2::X, Vec2::X)), None);
        assert_eq!(Conic::of_factor(Mat2::NAN), None);
    }

    #[test]
    fn over_backward_is_the_derivative_of_forward() {
        let accuracy = Accuracy::default();
        let colors = [[0.9, 0.1, 0.3], [0.2, 0.7, 0.5], [0.4, 0.4, 0.8]];
        let background = [1.0, 0.5, 0.25];
        let v = [0.3, -0.7, 0.2];
        let loss = |alphas: [f32; 3]| -> f32 {
            let mut p = over::Forward::default();
            for (&a, &c) in alphas.iter().zip(&colors) {
                assert!(over::blend_fwd(&mut p, a, c, &accuracy));
            }
            (0..3).map(|k| v[k] * (p.color[k] + p.transmittance * background[k])).sum()
        };
        let alphas = [0.3, 0.8, 0.5];
        let mut p = over::Forward::default();
        for (&a, &c) in alphas.iter().zip(&colors) {
            over::blend_fwd(&mut p, a, c, &accuracy);
        }
        let color = [0, 1, 2].map(|k| p.color[k] + p.transmittance * background[k]);
        let mut back = over::Backward::new(v, color);
        for i in 0..3 {
            let (v_alpha, _) = over::blend_bwd(&mut back, alphas[i], colors[i], &accuracy).unwrap();
            let (mut up, mut down) = (alphas, alphas);
            up[i] += 1e-2;
            down[i] -= 1e-2;
            let numeric = (loss(up) - loss(down)) / 2e-2;
            assert!((v_alpha - numeric).abs() < 1e-4, "{i}: {v_alpha} against {numeric}");
        }
    }
}
