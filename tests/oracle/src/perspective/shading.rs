//! Opacity and colour of a 3D Gaussian as a camera sees it.

use gs_core::{CullCause, RenderSettings, effects::Blend};

use super::Covariance;
use crate::{
    parameters::{SH_3D, sh_len},
    rounded::Rounded,
    spherical_harmonics,
    splat::Appearance,
};

/// A Gaussian's opacity.
pub(super) struct Opacity {
    /// sigmoid(logit), or 1.
    pub(super) stored: Rounded,
    /// The antialiasing factor times the dropout gain.
    pub(super) compensation: Rounded,
    /// ∂(compensation)/∂Σ, where uv stands for both entries.
    pub(super) compensation_slope: [Rounded; 3],
    /// The opacity in pixels.
    pub(super) shown: Rounded,
    /// ∂(shown)/∂(the opacity's entry of a share).
    pub(super) slope: f64,
}

impl Opacity {
    pub(super) fn new(logit: f64, settings: &RenderSettings, covariance: &Covariance) -> Self {
        let (compensation, compensation_slope) = covariance.compensation(settings.effects.antialias);
        let gain = Rounded::ONE / (Rounded::ONE - Rounded::exact(settings.dropout.rate.into()));
        let (compensation, compensation_slope) = (compensation * gain, compensation_slope.map(|slope| slope * gain));
        let (stored, shown, slope) = match settings.effects.blend {
            // Without an opacity there is nothing to compensate.
            Blend::Sum => (Rounded::ONE, Rounded::ONE, 0.0),
            Blend::Over => {
                let stored = sigmoid(logit);
                (stored, stored * compensation, 1.0)
            }
        };
        Self { stored, compensation, compensation_slope, shown, slope }
    }
}

/// A Gaussian's colour as seen from the camera.
pub(super) struct Shading {
    /// Evaluated coefficients, `[k][channel]`.
    pub(super) sh: Vec<[f64; 3]>,
    /// RGB, clamped at 0.
    pub(super) color: [Rounded; 3],
    /// Channels that are not clamped.
    pub(super) shows: [bool; 3],
}

impl Shading {
    pub(super) fn new(g: &[f64], direction: &[Rounded; 3], degree: u8) -> Result<Self, CullCause> {
        let evaluated = sh_len(g).min((usize::from(degree) + 1).pow(2));
        let sh: Vec<[f64; 3]> = (0..evaluated).map(|k| [0, 1, 2].map(|channel| g[SH_3D + 3 * k + channel])).collect();
        let color = [0, 1, 2].map(|channel| {
            let sum = (0..evaluated)
                .map(|k| Rounded::exact(sh[k][channel]) * spherical_harmonics::basis(k, direction))
                .sum::<Rounded>();
            Rounded::exact(0.5) + sum
        });
        if !color.into_iter().all(Rounded::is_finite) {
            return Err(CullCause::NotFinite);
        }
        let shows = color.map(|c| c.value > 0.0);
        let color = [0, 1, 2].map(|k| if shows[k] { color[k] } else { Rounded::ZERO });
        Ok(Self { sh, color, shows })
    }

    /// A value in place of the colour.
    pub(super) fn constant(value: Rounded) -> Self {
        Self { sh: Vec::new(), color: [value; 3], shows: [true; 3] }
    }
}

pub(super) fn appearance(opacity: &Opacity, shading: &Shading, undecided: bool) -> Appearance {
    Appearance {
        opacity: opacity.shown.value,
        opacity_rounding: opacity.shown.relative(),
        opacity_slope: opacity.slope,
        color: shading.color.map(|c| c.value),
        color_rounding: shading.color.map(|c| c.error),
        undecided,
    }
}

/// 1 / (1 + exp(−logit)); 0 and 1 at ±∞.
fn sigmoid(logit: f64) -> Rounded {
    if logit.is_infinite() {
        return Rounded::exact(f64::from(u8::from(logit > 0.0)));
    }
    // This form of the two has the exponential that does not overflow.
    let small = Rounded::exact(-logit.abs()).exp();
    let part = if logit < 0.0 { small } else { Rounded::ONE };
    part / (Rounded::ONE + small)
}
