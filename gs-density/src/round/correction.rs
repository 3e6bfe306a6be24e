//! Correction of opacities where two Gaussians replace one.

use gs_core::{logit, sigmoid};
use serde::{Deserialize, Serialize};

use crate::observation::DensityGaussian;

/// Correction of the opacities of two Gaussians that replace one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum OpacityCorrection {
    /// Nothing: both keep the opacity, as in 3DGS. Where they overlap, they hide more than the one
    /// did.
    #[default]
    None,
    /// Two Gaussians with the scales of the one that they replace look as it did.
    ///
    /// In a scene with opacities both get 1 − √(1 − α). Blended one right behind the other, they
    /// have exactly the opacity of the one at its mean. Elsewhere, at weight w, they have α'² w (1
    /// − w) more, where α' is their own opacity (at most a quarter of α'²: no two equal Gaussians
    /// composite to a Gaussian).
    ///
    /// In a scene without opacities, where Gaussians are summed, the colours are halved instead,
    /// which is exact everywhere.
    Conserve,
    /// Both get half of the opacity, or of the colour where Gaussians are summed: to first order in
    /// the opacity the two look as the one did (SteepGS).
    Halve,
}

impl OpacityCorrection {
    /// Corrects one of the two; `has_opacity` is a property of the scene.
    pub(crate) fn apply<G: DensityGaussian>(self, half: &mut G, has_opacity: bool) {
        match (self, has_opacity) {
            (Self::None, _) => {}
            (Self::Conserve, true) => half.set_opacity_logit(logit_of_half(half.opacity_logit())),
            (Self::Halve, true) => half.set_opacity_logit(logit(0.5 * sigmoid(half.opacity_logit()))),
            (Self::Conserve | Self::Halve, false) => half.map_color(|color| color * 0.5),
        }
    }
}

/// The logit of 1 − √(1 − α) from the logit x of α, for −∞ ≤ x ≤ ∞.
///
/// With s = √(1 − α): 1 − s = α / (1 + s), which does not cancel for small α, so the logit is ln α
/// − ln(1 + s) − ln s, where ln α = −softplus(−x) and ln s = −½ softplus(x).
fn logit_of_half(logit: f32) -> f32 {
    if logit.is_infinite() {
        return logit;
    }
    let softplus = |x: f64| x.max(0.0) + (-x.abs()).exp().ln_1p();
    let x = f64::from(logit);
    let ln_s = -0.5 * softplus(x);
    (-softplus(-x) - ln_s.exp().ln_1p() - ln_s) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_halves_composite_to_the_whole() {
        for alpha in [1e-6, 0.005, 0.01, 0.1, 0.3, 0.5, 0.8, 0.99, 0.999, 0.999_99] {
            let half = sigmoid(logit_of_half(logit(alpha)));
            let both = 1.0 - (1.0 - half) * (1.0 - half);
            assert!((both - alpha).abs() < 1e-6, "{alpha}: {half} twice is {both}");
        }
    }

    #[test]
    fn half_of_the_opacity_is_half_of_it() {
        let mut half = gs_core::Gaussian2d {
            mean: glam::Vec2::ZERO,
            log_scale: glam::Vec2::ZERO,
            rotation: 0.0,
            opacity_logit: logit(0.6),
            color: glam::Vec3::ONE,
        };
        OpacityCorrection::Halve.apply(&mut half, true);
        assert!((sigmoid(half.opacity_logit) - 0.3).abs() < 1e-6 && half.color == glam::Vec3::ONE);
        OpacityCorrection::Halve.apply(&mut half, false);
        assert_eq!(half.color, glam::Vec3::splat(0.5));
    }

    #[test]
    fn small_and_extreme_logits_lose_nothing() {
        // α = e⁻³⁰: the half is α / 2, though 1 − √(1 − α) would be 0 in f32.
        assert!((logit_of_half(-30.0) - (-30.0 - 2f32.ln())).abs() < 1e-5);
        assert!(logit_of_half(2000.0).is_finite());
        assert_eq!(logit_of_half(f32::INFINITY), f32::INFINITY);
        assert_eq!(logit_of_half(f32::NEG_INFINITY), f32::NEG_INFINITY);
    }

    #[test]
    fn away_from_the_mean_the_excess_is_as_documented() {
        let (alpha, w) = (0.8f32, 0.4f32);
        let half = sigmoid(logit_of_half(logit(alpha)));
        let excess = 1.0 - (1.0 - half * w).powi(2) - alpha * w;
        assert!((excess - half * half * w * (1.0 - w)).abs() < 1e-6);
        assert!(excess <= 0.25 * half * half);
    }
}
