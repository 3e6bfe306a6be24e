//! One pixel, all Gaussians: what it shows, what each Gaussian has to do with that, and how near it is to a discontinuity.
//!
//! Legend: w = weight, o = opacity, α = min(o·w, α_max), T = transmittance in front of a Gaussian, B = what is seen behind it,
//! `v_x` = ∂L/∂x.

use gs_core::{
    RenderSettings,
    effects::Blend,
    settings::{Accuracy, Cut},
};

use super::{
    parameters::{COLOR, OPACITY, Parameters},
    project::{Exponent, F32_ROUNDING, Projected},
};
use crate::tolerance::{NEAR_CUT, ROUNDINGS};

/// Roundings of one weight besides those of its σ: the exponential, products, sums.
const OPERATIONS: f64 = 8.0;

/// To which side decisions fall that are within rounding of their threshold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Lean {
    /// As `f64` has it.
    Exact,
    /// Whatever nearly counts, counts.
    More,
    /// Whatever nearly does not count, does not.
    Fewer,
}

impl Lean {
    /// Whether `value` reaches `threshold`, give or take a relative `band`.
    fn reaches(self, value: f64, threshold: f64, band: f64) -> bool {
        match self {
            Self::Exact => value >= threshold,
            Self::More => value * (1.0 + band) >= threshold,
            Self::Fewer => value * (1.0 - band) >= threshold,
        }
    }
}

/// One Gaussian that counts at a pixel.
#[derive(Debug, Clone, Copy)]
struct Touch {
    index: usize,
    exponent: Exponent,
    color: [f64; 3],
    opacity: f64,
    /// w under `Sum`, o·w under `Over`.
    value: f64,
    /// `value`, clamped under `Over`.
    alpha: f64,
    /// Whether the clamp takes the gradient.
    clamped: bool,
    /// T; 1 under `Sum`.
    transmittance: f64,
    /// Relative rounding of `value`.
    value_rounding: f64,
    /// Relative rounding of T.
    transmittance_rounding: f64,
}

/// One pixel, blended.
#[derive(Debug, Clone)]
pub(crate) struct Pixel {
    touches: Vec<Touch>,
    blend: Blend,
    backdrop: [f64; 3],
    /// What it shows, backdrop included.
    pub(crate) color: [f64; 3],
    /// What blending in `f32` may change `color` by, in roundings.
    pub(crate) rounding: [f64; 3],
    /// What decisions that are within rounding may change `color` by.
    pub(crate) flip: [f64; 3],
    /// How many decisions (cut, full, clamp) are within rounding.
    pub(crate) near: u32,
}

impl Pixel {
    /// Blends all Gaussians, in order, at the pixel centre `p`.
    pub(crate) fn blend(projected: &[Option<Projected>], p: [f64; 2], settings: &RenderSettings, lean: Lean) -> Self {
        let backdrop = settings.backdrop().map(f64::from);
        let mut pixel = Self {
            touches: Vec::new(),
            blend: settings.effects.blend,
            backdrop,
            color: [0.0; 3],
            rounding: [0.0; 3],
            flip: [0.0; 3],
            near: 0,
        };
        match settings.effects.blend {
            Blend::Sum => pixel.sum(projected, p, &settings.accuracy, lean),
            Blend::Over => pixel.over(projected, p, &settings.accuracy, lean),
        }
        pixel
    }

    /// C = backdrop + Σ w c, w cut.
    fn sum(&mut self, projected: &[Option<Projected>], p: [f64; 2], accuracy: &Accuracy, lean: Lean) {
        self.color = self.backdrop;
        self.rounding = self.backdrop.map(|b| F32_ROUNDING * b.abs());
        for (index, g) in projected.iter().enumerate().filter_map(|(i, g)| g.as_ref().map(|g| (i, g))) {
            let exponent = g.exponent(p);
            let w = (-exponent.sigma).exp();
            let value_rounding = exponent.rounding + OPERATIONS * F32_ROUNDING;
            if !self.survives_cut(w, value_rounding, accuracy, lean, g.color.map(|c| w * c.abs())) {
                continue;
            }
            for k in 0..3 {
                self.color[k] += w * g.color[k];
                self.rounding[k] += w * g.color[k].abs() * value_rounding;
            }
            self.touches.push(Touch {
                index,
                exponent,
                color: g.color,
                opacity: 1.0,
                value: w,
                alpha: w,
                clamped: false,
                transmittance: 1.0,
                value_rounding,
                transmittance_rounding: 0.0,
            });
        }
    }

    /// C = Σ T α c + T backdrop, front to back, until the pixel is full.
    fn over(&mut self, projected: &[Option<Projected>], p: [f64; 2], accuracy: &Accuracy, lean: Lean) {
        let (alpha_max, minimum) = (f64::from(accuracy.alpha_max), f64::from(accuracy.transmittance_min));
        let mut brightest = self.backdrop.map(f64::abs);
        projected.iter().flatten().for_each(|g| (0..3).for_each(|k| brightest[k] = brightest[k].max(g.color[k].abs())));
        let (mut t, mut t_rounding) = (1.0, 0.0);
        for (index, g) in projected.iter().enumerate().filter_map(|(i, g)| g.as_ref().map(|g| (i, g))) {
            let exponent = g.exponent(p);
            let value = g.opacity * (-exponent.sigma).exp();
            let value_rounding = exponent.rounding + OPERATIONS * F32_ROUNDING;
            // Including it or not replaces α of what is behind by its own colour.
            if !self.survives_cut(value, value_rounding, accuracy, lean, brightest.map(|b| 2.0 * t * value * b)) {
                continue;
            }
            let alpha = value.min(alpha_max);
            // Here the image is continuous, but the gradient is not.
            let clamp_band = ROUNDINGS * value_rounding;
            let clamped = lean.reaches(value, alpha_max, clamp_band) && value != alpha_max;
            self.near += u32::from((value / alpha_max - 1.0).abs() <= clamp_band);
            let alpha_rounding = if value > alpha_max * (1.0 + clamp_band) { 0.0 } else { value_rounding };

            let behind = t * (1.0 - alpha);
            let behind_rounding = t_rounding + alpha_rounding * alpha / (1.0 - alpha) + F32_ROUNDING;
            let full_band = NEAR_CUT.max(ROUNDINGS * behind_rounding);
            if (behind - minimum).abs() <= full_band * minimum {
                self.near += 1;
                (0..3).for_each(|k| self.flip[k] += 2.0 * t * brightest[k]);
            }
            if !lean.reaches(behind, minimum, full_band) {
                break;
            }
            for k in 0..3 {
                self.color[k] += t * alpha * g.color[k];
                self.rounding[k] += t * alpha * g.color[k].abs() * (alpha_rounding + t_rounding + F32_ROUNDING);
            }
            self.touches.push(Touch {
                index,
                exponent,
                color: g.color,
                opacity: g.opacity,
                value,
                alpha,
                clamped,
                transmittance: t,
                value_rounding: alpha_rounding,
                transmittance_rounding: t_rounding,
            });
            (t, t_rounding) = (behind, behind_rounding);
        }
        for k in 0..3 {
            self.color[k] += t * self.backdrop[k];
            self.rounding[k] += t * self.backdrop[k].abs() * (t_rounding + F32_ROUNDING);
        }
    }

    /// The cut, taking note where it is within rounding; `change` is what it decides about.
    fn survives_cut(&mut self, value: f64, rounding: f64, accuracy: &Accuracy, lean: Lean, change: [f64; 3]) -> bool {
        if accuracy.cut == Cut::Smooth {
            return true;
        }
        let cut = f64::from(accuracy.alpha_cut);
        let band = NEAR_CUT.max(ROUNDINGS * rounding);
        if (value / cut - 1.0).abs() <= band {
            self.near += 1;
            (0..3).for_each(|k| self.flip[k] += change[k]);
        }
        lean.reaches(value, cut, band)
    }

    /// The Gaussians that count.
    pub(crate) fn touched(&self) -> impl Iterator<Item = usize> + '_ {
        self.touches.iter().map(|touch| touch.index)
    }

    /// (Gaussian, what the pixel shows of it): T α, under `Sum` w.
    pub(crate) fn shown(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.touches.iter().map(|touch| (touch.index, touch.transmittance * touch.alpha))
    }

    /// (Gaussian, its weight w), for `Sum`.
    pub(crate) fn weights(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.touches.iter().map(|touch| (touch.index, touch.value))
    }

    /// This pixel's share of ∂L/∂(parameters), per Gaussian that counts, from v_C.
    ///
    /// Under `Over`, C = … + T (α c + (1 − α) B), so v_α = T (c − B) · v_C, with B gathered from the back.
    pub(crate) fn gradients(&self, v_color: [f64; 3]) -> Vec<(usize, Parameters)> {
        let mut behind = self.backdrop;
        let mut shares: Vec<_> = self
            .touches
            .iter()
            .rev()
            .map(|touch| {
                let rest = if self.blend == Blend::Over { behind } else { [0.0; 3] };
                let v_alpha: f64 = (0..3).map(|k| v_color[k] * touch.transmittance * (touch.color[k] - rest[k])).sum();
                behind = [0, 1, 2].map(|k| touch.alpha * touch.color[k] + (1.0 - touch.alpha) * behind[k]);
                let mut share = [0.0; 9];
                if !touch.clamped {
                    for (entry, derivative) in share.iter_mut().zip(touch.exponent.derivatives) {
                        *entry = -v_alpha * touch.value * derivative;
                    }
                    share[OPACITY] = v_alpha * touch.value * (1.0 - touch.opacity);
                }
                for k in 0..3 {
                    share[COLOR + k] = v_color[k] * touch.transmittance * touch.alpha;
                }
                (touch.index, share)
            })
            .collect();
        shares.reverse();
        shares
    }

    /// What `f32` may change [`Self::gradients`] by, in roundings, where v_C itself is uncertain by `v_rounding`.
    ///
    /// Allows for the usual way to find B: the finished colour less what is in front, divided by T (1 − α).
    pub(crate) fn gradient_rounding(&self, v_color: [f64; 3], v_rounding: [f64; 3]) -> Vec<(usize, Parameters)> {
        let mut behind = self.backdrop.map(f64::abs);
        let mut all = behind;
        for touch in self.touches.iter().rev() {
            all = [0, 1, 2].map(|k| touch.alpha * touch.color[k].abs() + (1.0 - touch.alpha) * all[k]);
        }
        let mut shares: Vec<_> = self
            .touches
            .iter()
            .rev()
            .map(|touch| {
                let relative = touch.value_rounding + touch.transmittance_rounding + OPERATIONS * F32_ROUNDING;
                let over = self.blend == Blend::Over;
                let (mut v_alpha, mut v_alpha_rounding) = (0.0, 0.0);
                for k in 0..3 {
                    let size = touch.transmittance * (touch.color[k].abs() + if over { behind[k] } else { 0.0 });
                    v_alpha += v_color[k].abs() * size;
                    v_alpha_rounding += v_rounding[k] * size;
                    if over {
                        v_alpha_rounding += v_color[k].abs() * OPERATIONS * F32_ROUNDING * all[k] / (1.0 - touch.alpha);
                    }
                }
                behind = [0, 1, 2].map(|k| touch.alpha * touch.color[k].abs() + (1.0 - touch.alpha) * behind[k]);
                let mut share = [0.0; 9];
                if !touch.clamped {
                    let uncertain = v_alpha * relative + v_alpha_rounding;
                    let Exponent { derivatives, magnitudes, .. } = touch.exponent;
                    for (i, entry) in share[..5].iter_mut().enumerate() {
                        let own = v_alpha * OPERATIONS * F32_ROUNDING * magnitudes[i];
                        *entry = touch.value * (uncertain * derivatives[i].abs() + own);
                    }
                    share[OPACITY] = uncertain * touch.value * (1.0 - touch.opacity);
                }
                for k in 0..3 {
                    let size = touch.transmittance * touch.alpha;
                    share[COLOR + k] = size * (v_color[k].abs() * relative + v_rounding[k]);
                }
                (touch.index, share)
            })
            .collect();
        shares.reverse();
        shares
    }
}
