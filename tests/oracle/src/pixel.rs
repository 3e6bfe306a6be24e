//! A pixel and all Gaussians: its colour, each Gaussian's gradient, and the distance to a
//! discontinuity, in 2D and 3D views.
//!
//! Legend: w = weight, o = opacity, α = min(o·w, α_max), T = transmittance in front of a Gaussian,
//! B = colour behind it, `v_x` = ∂L/∂x.

use gs_core::{
    Accuracy, Cut, RenderSettings,
    effects::{Blend, Order},
};

use super::{
    rounded::F32_ROUNDING,
    splat::{COLOR_SHARE, Depth, Exponent, Lean, OPACITY_SHARE, Share, Splat},
};
use crate::{NEAR_CUT, ROUNDINGS};

/// Roundings of a weight in addition to those of its σ: the exponential, products, sums.
const OPERATIONS: f64 = 8.0;

/// A Gaussian that contributes to a pixel.
#[derive(Debug, Clone, Copy)]
struct Touch {
    index: usize,
    exponent: Exponent,
    color: [f64; 3],
    color_rounding: [f64; 3],
    opacity_slope: f64,
    /// exp(−σ).
    weight: f64,
    /// w under `Sum`, o·w under `Over`.
    value: f64,
    /// `value`, clamped under `Over`.
    alpha: f64,
    /// Whether the clamp makes the gradient 0.
    clamped: bool,
    /// T; 1 under `Sum`.
    transmittance: f64,
    /// Relative rounding of `value`.
    value_rounding: f64,
    /// Relative rounding of T.
    transmittance_rounding: f64,
}

/// A Gaussian that may contribute to a pixel.
struct Candidate<'s> {
    index: usize,
    splat: &'s dyn Splat,
    exponent: Exponent,
    weight: f64,
    /// o·w.
    value: f64,
    /// Relative rounding of `value`.
    rounding: f64,
    /// Whether rounding may put it in front of its predecessor.
    tied: bool,
}

/// One pixel, blended.
#[derive(Debug, Clone)]
pub(crate) struct Pixel {
    touches: Vec<Touch>,
    blend: Blend,
    background: [f64; 3],
    /// The colour, background included.
    pub(crate) color: [f64; 3],
    /// Uncertainty of `color` in `f32`, in roundings.
    pub(crate) rounding: [f64; 3],
    /// Change of `color` by decisions within rounding.
    pub(crate) flip: [f64; 3],
    /// Number of decisions (guard, order, cut, full, clamp) within rounding.
    pub(crate) near: u32,
}

impl Pixel {
    /// Blends all Gaussians at the pixel centre `p`, in the order of the settings.
    pub(crate) fn blend(splats: &[Option<Box<dyn Splat>>], p: [f64; 2], settings: &RenderSettings, lean: Lean) -> Self {
        let background = settings.background_color().map(f64::from);
        let mut pixel = Self {
            touches: Vec::new(),
            blend: settings.effects.blend,
            background,
            color: [0.0; 3],
            rounding: [0.0; 3],
            flip: [0.0; 3],
            near: 0,
        };
        match settings.effects.blend {
            Blend::Sum => pixel.sum(splats, p, &settings.accuracy, lean),
            Blend::Over => {
                let mut candidates = candidates(splats, p, &settings.accuracy);
                arrange(&mut candidates, p, settings.effects.order, lean);
                pixel.over(&candidates, &settings.accuracy, lean);
            }
        }
        pixel
    }

    /// C = background + Σ w c, w cut.
    fn sum(&mut self, splats: &[Option<Box<dyn Splat>>], p: [f64; 2], accuracy: &Accuracy, lean: Lean) {
        self.color = self.background;
        self.rounding = self.background.map(|b| F32_ROUNDING * b.abs());
        for (index, splat) in splats.iter().enumerate().filter_map(|(i, splat)| splat.as_ref().map(|s| (i, s))) {
            let (exponent, seen) = (splat.exponent(p), splat.appearance());
            let w = (-exponent.sigma).exp();
            let value_rounding = exponent.rounding + OPERATIONS * F32_ROUNDING;
            let change = seen.color.map(|c| w * c.abs());
            if !self.survives_cut(w, value_rounding, accuracy, lean, change) {
                continue;
            }
            self.count_decision(seen.undecided, change);
            for k in 0..3 {
                self.color[k] += w * seen.color[k];
                self.rounding[k] += w * (seen.color[k].abs() * value_rounding + seen.color_rounding[k]);
            }
            self.touches.push(Touch {
                index,
                exponent,
                color: seen.color,
                color_rounding: seen.color_rounding,
                opacity_slope: 0.0,
                weight: w,
                value: w,
                alpha: w,
                clamped: false,
                transmittance: 1.0,
                value_rounding,
                transmittance_rounding: 0.0,
            });
        }
    }

    /// C = Σ T α c + T background, front to back, until the pixel is full.
    fn over(&mut self, candidates: &[Candidate<'_>], accuracy: &Accuracy, lean: Lean) {
        let (alpha_max, minimum) = (f64::from(accuracy.alpha_max), f64::from(accuracy.transmittance_min));
        let mut brightest = self.background.map(f64::abs);
        for candidate in candidates {
            let color = candidate.splat.appearance().color;
            (0..3).for_each(|k| brightest[k] = brightest[k].max(color[k].abs()));
        }
        let (mut t, mut t_rounding) = (1.0, 0.0);
        let mut run_start = 0;
        for (place, candidate) in candidates.iter().enumerate() {
            let (seen, value, value_rounding) = (candidate.splat.appearance(), candidate.value, candidate.rounding);
            // This decides whether a share α of the colour behind becomes its own colour.
            let change = brightest.map(|b| 2.0 * t * value * b);
            if !self.survives_cut(value, value_rounding, accuracy, lean, change) {
                continue;
            }
            self.count_decision(seen.undecided, change);
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
                self.count_decision(true, brightest.map(|b| 2.0 * t * b));
            }
            if !lean.reaches(behind, minimum, full_band) {
                // If neighbours may swap places, the one that fills the pixel decides about all of
                // them.
                let next_is_tied = candidates.get(place + 1).is_some_and(|next| next.tied);
                if candidate.tied || next_is_tied {
                    let first = self.touches.get(run_start).filter(|_| candidate.tied);
                    let before = first.map_or(t, |touch| touch.transmittance);
                    self.count_decision(true, brightest.map(|b| 2.0 * before * b));
                }
                break;
            }
            // Swapping two neighbours changes the pixel by T αᵢ αⱼ (cᵢ − cⱼ).
            run_start = if candidate.tied { run_start } else { self.touches.len() };
            for swapped in run_start..self.touches.len() {
                let other = self.touches[swapped];
                let both = other.transmittance * other.alpha * alpha;
                self.count_decision(true, [0, 1, 2].map(|k| both * (other.color[k] - seen.color[k]).abs()));
            }
            for k in 0..3 {
                let relative = alpha_rounding + t_rounding + F32_ROUNDING;
                self.color[k] += t * alpha * seen.color[k];
                self.rounding[k] += t * alpha * (seen.color[k].abs() * relative + seen.color_rounding[k]);
            }
            self.touches.push(Touch {
                index: candidate.index,
                exponent: candidate.exponent,
                color: seen.color,
                color_rounding: seen.color_rounding,
                opacity_slope: seen.opacity_slope,
                weight: candidate.weight,
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
            self.color[k] += t * self.background[k];
            self.rounding[k] += t * self.background[k].abs() * (t_rounding + F32_ROUNDING);
        }
    }

    /// Applies the cut, and counts decisions within rounding; `change` is the colour that depends
    /// on it.
    fn survives_cut(&mut self, value: f64, rounding: f64, accuracy: &Accuracy, lean: Lean, change: [f64; 3]) -> bool {
        if accuracy.cut == Cut::Smooth {
            return true;
        }
        let cut = f64::from(accuracy.alpha_cut);
        let band = NEAR_CUT.max(ROUNDINGS * rounding);
        self.count_decision((value / cut - 1.0).abs() <= band, change);
        lean.reaches(value, cut, band)
    }

    /// Counts a decision about `change` if it is within rounding.
    fn count_decision(&mut self, within_rounding: bool, change: [f64; 3]) {
        if within_rounding {
            self.near += 1;
            (0..3).for_each(|k| self.flip[k] += change[k]);
        }
    }

    /// The Gaussians that contribute.
    pub(crate) fn touched(&self) -> impl Iterator<Item = usize> + '_ {
        self.touches.iter().map(|touch| touch.index)
    }

    /// (Gaussian, its share of the pixel): T α, under `Sum` w.
    pub(crate) fn shown(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.touches.iter().map(|touch| (touch.index, touch.transmittance * touch.alpha))
    }

    /// (Gaussian, its weight w), for `Sum`.
    pub(crate) fn weights(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.touches.iter().map(|touch| (touch.index, touch.value))
    }

    /// The gradients by the shares of the Gaussians that contribute, from v_C.
    ///
    /// Under `Over`, C = … + T (α c + (1 − α) B), so v_α = T (c − B) · v_C, with B gathered from
    /// the back.
    pub(crate) fn gradients(&self, v_color: [f64; 3]) -> Vec<(usize, Share)> {
        let mut behind = self.background;
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
                    share[OPACITY_SHARE] = v_alpha * touch.weight * touch.opacity_slope;
                }
                for k in 0..3 {
                    share[COLOR_SHARE + k] = v_color[k] * touch.transmittance * touch.alpha;
                }
                (touch.index, share)
            })
            .collect();
        shares.reverse();
        shares
    }

    /// Uncertainty of [`Self::gradients`] in `f32`, in roundings, if v_C is uncertain by
    /// `v_rounding`.
    ///
    /// Three parts change all numbers of a share together (its factor, and the centre's
    /// coordinates); the last part is of each number alone. It allows for the usual computation of
    /// B: the finished colour minus that in front, divided by T (1 − α).
    pub(crate) fn gradient_rounding(&self, v_color: [f64; 3], v_rounding: [f64; 3]) -> Vec<(usize, [Share; 3], Share)> {
        let mut behind = self.background.map(f64::abs);
        let mut behind_rounding = [0.0; 3];
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
                    v_alpha_rounding +=
                        v_color[k].abs() * touch.transmittance * (touch.color_rounding[k] + behind_rounding[k]);
                    if over {
                        v_alpha_rounding += v_color[k].abs() * OPERATIONS * F32_ROUNDING * all[k] / (1.0 - touch.alpha);
                    }
                }
                let through = 1.0 - touch.alpha;
                behind = [0, 1, 2].map(|k| touch.alpha * touch.color[k].abs() + through * behind[k]);
                if over {
                    behind_rounding =
                        [0, 1, 2].map(|k| touch.alpha * touch.color_rounding[k] + through * behind_rounding[k]);
                }
                let (mut together, mut own) = ([[0.0; 9]; 3], [0.0; 9]);
                if !touch.clamped {
                    let uncertain = v_alpha * relative + v_alpha_rounding;
                    let Exponent { derivatives, derivative_rounding, displaced, .. } = touch.exponent;
                    for i in 0..5 {
                        together[0][i] = touch.value * uncertain * derivatives[i];
                        together[1][i] = touch.value * v_alpha * displaced[0][i];
                        together[2][i] = touch.value * v_alpha * displaced[1][i];
                        own[i] = touch.value * v_alpha * derivative_rounding[i];
                    }
                    own[OPACITY_SHARE] = uncertain * touch.weight * touch.opacity_slope;
                }
                for k in 0..3 {
                    let size = touch.transmittance * touch.alpha;
                    own[COLOR_SHARE + k] = size * (v_color[k].abs() * relative + v_rounding[k]);
                }
                (touch.index, together, own)
            })
            .collect();
        shares.reverse();
        shares
    }
}

/// All Gaussians that may survive the cut at the pixel centre `p`, in the order of the scene.
fn candidates<'s>(splats: &'s [Option<Box<dyn Splat>>], p: [f64; 2], accuracy: &Accuracy) -> Vec<Candidate<'s>> {
    let there = splats.iter().enumerate().filter_map(|(i, splat)| splat.as_ref().map(|s| (i, s)));
    let all = there.map(|(index, splat)| {
        let (exponent, seen) = (splat.exponent(p), splat.appearance());
        let weight = (-exponent.sigma).exp();
        let rounding = exponent.rounding + seen.opacity_rounding + OPERATIONS * F32_ROUNDING;
        Candidate {
            index,
            splat: splat.as_ref(),
            exponent,
            weight,
            value: seen.opacity * weight,
            rounding,
            tied: false,
        }
    });
    all.filter(|c| {
        let cut = f64::from(accuracy.alpha_cut);
        let band = NEAR_CUT.max(ROUNDINGS * c.rounding);
        accuracy.cut == Cut::Smooth || Lean::More.reaches(c.value, cut, band) || c.value >= cut * (1.0 - band)
    })
    .collect()
}

/// Sorts the candidates and marks neighbours whose order is within rounding. With a `lean`, these
/// are reversed.
fn arrange(candidates: &mut Vec<Candidate<'_>>, p: [f64; 2], order: Order, lean: Lean) {
    if order == Order::Index {
        return;
    }
    let mut by_depth: Vec<(Depth, Candidate<'_>)> =
        candidates.drain(..).map(|c| (c.splat.depth(p, order), c)).collect();
    by_depth.sort_by(|(a, _), (b, _)| a.value.total_cmp(&b.value)); // Stable: ties by index.
    for i in 1..by_depth.len() {
        by_depth[i].1.tied = by_depth[i].0.is_tied_with(&by_depth[i - 1].0);
    }
    if lean != Lean::Exact {
        for run in by_depth.chunk_by_mut(|_, next| next.1.tied) {
            run.reverse();
            let last = run.len() - 1;
            run[last].1.tied = last > 0;
            run[0].1.tied = false;
        }
    }
    candidates.extend(by_depth.into_iter().map(|(_, candidate)| candidate));
}
