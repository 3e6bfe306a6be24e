//! A Gaussian at a pixel under [`Blend::Over`](gs_core::Blend::Over): C = Σ T α c, front to back
//! (paper eq. 2).
//!
//! Legend: w = weight, o = opacity, α = min(o·w, α_max), T = transmittance before this Gaussian,
//! `v_x` = ∂L/∂x.

use gs_core::Accuracy;

/// State of a pixel while it is blended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Forward {
    /// Σ T α c so far.
    pub(super) color: [f32; 3],
    /// T = Π (1 − α) so far.
    pub(super) transmittance: f32,
    /// Whether T would have fallen below the minimum; no further Gaussian counts then.
    pub(super) full: bool,
}

impl Default for Forward {
    fn default() -> Self {
        Self { color: [0.0; 3], transmittance: 1.0, full: false }
    }
}

/// α = min(o·w, α_max).
pub(super) fn alpha(opacity_times_weight: f32, accuracy: &Accuracy) -> f32 {
    opacity_times_weight.min(accuracy.alpha_max)
}

/// Blends a Gaussian behind the previous ones; returns whether it counted.
pub(super) fn blend_fwd(pixel: &mut Forward, alpha: f32, c: [f32; 3], accuracy: &Accuracy) -> bool {
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
pub(super) struct Backward {
    /// v_C of the finished pixel.
    pub(super) v_color: [f32; 3],
    /// v_C · (the part of the finished colour, background included, that is behind what was
    /// replayed so far).
    pub(super) v_rest: f32,
    /// T so far.
    pub(super) transmittance: f32,
    /// Whether the pixel is full ([`Forward::full`]).
    pub(super) full: bool,
}

impl Backward {
    /// Starts the replay of a pixel whose finished colour, background included, is `color`.
    pub(super) fn new(v_color: [f32; 3], color: [f32; 3]) -> Self {
        let v_rest = (0..3).map(|k| v_color[k] * color[k]).sum();
        Self { v_color, v_rest, transmittance: 1.0, full: false }
    }
}

/// (v_α, v_c) of the next Gaussian, `None` where it did not count. v_α = T c·v_C − rest/(1 −
/// α), where 1 − α is at least 1 − α_max. Where α was clamped the caller must take v_(o·w) = 0.
pub(super) fn blend_bwd(pixel: &mut Backward, alpha: f32, c: [f32; 3], accuracy: &Accuracy) -> Option<(f32, [f32; 3])> {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn over_backward_is_the_derivative_of_forward() {
        let accuracy = Accuracy::default();
        let colors = [[0.9, 0.1, 0.3], [0.2, 0.7, 0.5], [0.4, 0.4, 0.8]];
        let background = [1.0, 0.5, 0.25];
        let v = [0.3, -0.7, 0.2];
        let loss = |alphas: [f32; 3]| -> f32 {
            let mut p = Forward::default();
            for (&a, &c) in alphas.iter().zip(&colors) {
                assert!(blend_fwd(&mut p, a, c, &accuracy));
            }
            (0..3).map(|k| v[k] * (p.color[k] + p.transmittance * background[k])).sum()
        };
        let alphas = [0.3, 0.8, 0.5];
        let mut p = Forward::default();
        for (&a, &c) in alphas.iter().zip(&colors) {
            blend_fwd(&mut p, a, c, &accuracy);
        }
        let color = [0, 1, 2].map(|k| p.color[k] + p.transmittance * background[k]);
        let mut back = Backward::new(v, color);
        for i in 0..3 {
            let (v_alpha, _) = blend_bwd(&mut back, alphas[i], colors[i], &accuracy).unwrap();
            let (mut up, mut down) = (alphas, alphas);
            up[i] += 1e-2;
            down[i] -= 1e-2;
            let numeric = (loss(up) - loss(down)) / 2e-2;
            assert!((v_alpha - numeric).abs() < 1e-4, "{i}: {v_alpha} against {numeric}");
        }
    }
}
