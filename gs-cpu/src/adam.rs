//! Stage `adam`: one step of every Gaussian, in eight lanes (mean 2, shape 3, colour 3), and its statistics. Parallel over
//! Gaussians; `project_bwd` is fused into it where the gradients are not wanted otherwise.

use fearless_simd::{Level, Simd, dispatch, f32x8, prelude::*};
use glam::{Mat2, Vec2};
use gs_core::{AdamRates, PlanarGaussian, adam::Rate};

use crate::{
    cloud::{PlanarCloud, Shapes, VECTOR},
    project::CHUNK,
    project_bwd::{Gradient, scale_rotation},
};

/// Largest entry of η in one step; exp(η) is taken to second order.
const MAX_ETA: f32 = 0.5;

/// Moments below this are 0: denormals cost time and move nothing.
const VANISHING: f32 = 1e-30;

/// 1/(1 − β^t) for both moments of the eight lanes and the opacity.
#[derive(Debug, Clone, Copy)]
struct Bias {
    first: [f32; VECTOR],
    second: [f32; VECTOR],
    opacity: [f32; 2],
}

/// Bias corrections by step count, made once per set of betas.
#[derive(Debug, Default)]
pub(crate) struct BiasTable {
    betas: Vec<f32>,
    by_steps: Vec<Bias>,
}

/// Adam's numbers, lane by lane.
#[derive(Debug, Clone, Copy)]
struct LaneRates {
    rate: [f32; VECTOR],
    beta1: [f32; VECTOR],
    beta2: [f32; VECTOR],
}

fn lane_rates(rates: &AdamRates, cloud: &PlanarCloud) -> LaneRates {
    let third = match cloud.shapes {
        Shapes::ScaleRotation(_) => rates.rotation,
        Shapes::LocalFrame(_) => rates.scale,
    };
    let groups = [rates.mean, rates.mean, rates.scale, rates.scale, third, rates.color, rates.color, rates.color];
    LaneRates { rate: groups.map(|g| g.learning_rate), beta1: groups.map(|g| g.beta1), beta2: groups.map(|g| g.beta2) }
}

impl BiasTable {
    /// Makes sure of an entry for every count up to `steps`.
    fn prepare(&mut self, lanes: &LaneRates, opacity: Rate, steps: u32) {
        let betas = lanes.beta1.iter().chain(&lanes.beta2).chain([&opacity.beta1, &opacity.beta2]);
        if !self.betas.iter().eq(betas.clone()) {
            self.betas = betas.copied().collect();
            self.by_steps.clear();
        }
        for t in self.by_steps.len() as u32..=steps {
            let correction = |beta: f32| (1.0 / (1.0 - f64::from(beta).powi(t.max(1) as i32))) as f32;
            self.by_steps.push(Bias {
                first: lanes.beta1.map(correction),
                second: lanes.beta2.map(correction),
                opacity: [correction(opacity.beta1), correction(opacity.beta2)],
            });
        }
    }
}

/// A range of a cloud's arrays.
struct Slices<'a> {
    means: &'a mut [Vec2],
    scale_rotations: &'a mut [[f32; 3]],
    frames: &'a mut [Mat2],
    colors: &'a mut [[f32; 3]],
    opacity_logits: &'a mut [f32],
    first: &'a mut [[f32; VECTOR]],
    second: &'a mut [[f32; VECTOR]],
    opacity_moments: &'a mut [[f32; 2]],
    steps: &'a mut [u32],
    gradient_sum: &'a mut [f32],
    visible: &'a mut [u32],
}

impl<'a> Slices<'a> {
    fn split(self, at: usize) -> (Self, Self) {
        fn cut<T>(slice: &mut [T], at: usize) -> (&mut [T], &mut [T]) {
            let at = at.min(slice.len());
            slice.split_at_mut(at)
        }
        let (means, means_r) = cut(self.means, at);
        let (scale_rotations, scale_rotations_r) = cut(self.scale_rotations, at);
        let (frames, frames_r) = cut(self.frames, at);
        let (colors, colors_r) = cut(self.colors, at);
        let (opacity_logits, opacity_logits_r) = cut(self.opacity_logits, at);
        let (first, first_r) = cut(self.first, at);
        let (second, second_r) = cut(self.second, at);
        let (opacity_moments, opacity_moments_r) = cut(self.opacity_moments, at);
        let (steps, steps_r) = cut(self.steps, at);
        let (gradient_sum, gradient_sum_r) = cut(self.gradient_sum, at);
        let (visible, visible_r) = cut(self.visible, at);
        (
            Self {
                means,
                scale_rotations,
                frames,
                colors,
                opacity_logits,
                first,
                second,
                opacity_moments,
                steps,
                gradient_sum,
                visible,
            },
            Self {
                means: means_r,
                scale_rotations: scale_rotations_r,
                frames: frames_r,
                colors: colors_r,
                opacity_logits: opacity_logits_r,
                first: first_r,
                second: second_r,
                opacity_moments: opacity_moments_r,
                steps: steps_r,
                gradient_sum: gradient_sum_r,
                visible: visible_r,
            },
        )
    }
}

/// What all Gaussians of one step share.
struct Step<'a> {
    lanes: LaneRates,
    rates: &'a AdamRates,
    bias: &'a [Bias],
    collect: bool,
}

/// One Adam step of all Gaussians; `gradient(cloud as it was, index)` is asked for each. `collect`s statistics if so.
///
/// The gradients are taken from `gradients` where there are any.
pub(crate) fn step(
    cloud: &mut PlanarCloud,
    table: &mut BiasTable,
    rates: &AdamRates,
    level: Level,
    collect: bool,
    gradients: &[Gradient],
) {
    let lanes = lane_rates(rates, cloud);
    let most = cloud.steps.iter().max().map_or(0, |&t| t.saturating_add(1));
    table.prepare(&lanes, rates.opacity, most);
    let step = Step { lanes, rates, bias: &table.by_steps, collect };
    let PlanarCloud { means, shapes, colors, opacity_logits, moments: [first, second], opacity_moments, .. } = cloud;
    let (scale_rotations, frames): (&mut [_], &mut [_]) = match shapes {
        Shapes::ScaleRotation(shapes) => (shapes, &mut []),
        Shapes::LocalFrame(frames) => (&mut [], frames),
    };
    let slices = Slices {
        means,
        scale_rotations,
        frames,
        colors,
        opacity_logits,
        first,
        second,
        opacity_moments,
        steps: &mut cloud.steps,
        gradient_sum: &mut cloud.statistics.gradient_sum,
        visible: &mut cloud.statistics.visible,
    };
    divide(slices, gradients, &step, level);
}

fn divide(slices: Slices<'_>, gradients: &[Gradient], step: &Step<'_>, level: Level) {
    let n = gradients.len();
    if n <= CHUNK {
        dispatch!(level, simd => step_all(simd, slices, gradients, step));
        return;
    }
    let (left, right) = slices.split(n / 2);
    let (gradients_l, gradients_r) = gradients.split_at(n / 2);
    rayon::join(|| divide(left, gradients_l, step, level), || divide(right, gradients_r, step, level));
}

#[inline(always)]
fn step_all<S: Simd>(simd: S, slices: Slices<'_>, gradients: &[Gradient], step: &Step<'_>) {
    let local = slices.scale_rotations.is_empty();
    let lane = |values: [f32; VECTOR]| f32x8::load_array(simd, values);
    let (rate, beta1, beta2) = (lane(step.lanes.rate), lane(step.lanes.beta1), lane(step.lanes.beta2));
    let (rest1, rest2) = (1.0 - beta1, 1.0 - beta2);
    let (zero, epsilon) = (f32x8::splat(simd, 0.0), f32x8::splat(simd, step.rates.epsilon));
    for (i, gradient) in gradients.iter().enumerate() {
        let (by_mean, by_shape) = if local {
            (gradient.xi, gradient.eta)
        } else if gradient.visible {
            let [x, y, angle] = slices.scale_rotations[i];
            let (sin, cos) = angle.sin_cos();
            let l = Mat2::from_cols(Vec2::new(cos, sin) * x.exp(), Vec2::new(-sin, cos) * y.exp());
            scale_rotation(l, gradient)
        } else {
            (Vec2::ZERO, [0.0; 3])
        };
        let [r, g, b] = gradient.color;
        let g = lane([by_mean.x, by_mean.y, by_shape[0], by_shape[1], by_shape[2], r, g, b]);
        slices.steps[i] = slices.steps[i].saturating_add(1);
        let bias = &step.bias[slices.steps[i] as usize];

        let m = lane(slices.first[i]).mul_add(beta1, g * rest1);
        let m = m.abs().simd_lt(f32x8::splat(simd, VANISHING)).select(zero, m);
        let v = lane(slices.second[i]).mul_add(beta2, g * g * rest2);
        let v = v.simd_lt(f32x8::splat(simd, VANISHING * VANISHING)).select(zero, v);
        m.store_array(&mut slices.first[i]);
        v.store_array(&mut slices.second[i]);
        let moved = rate * (m * lane(bias.first)) / ((v * lane(bias.second)).sqrt() + epsilon);
        let moved: [f32; VECTOR] = moved.into();

        let [u, w, s0, s1, s2, colors @ ..] = moved;
        for k in 0..3 {
            slices.colors[i][k] -= colors[k];
        }
        if local {
            let l = slices.frames[i];
            slices.means[i] -= l * Vec2::new(u, w);
            slices.frames[i] = turn(l, [s0, s1, s2], step.rates.min_scale);
        } else {
            slices.means[i] -= Vec2::new(u, w);
            let shape = &mut slices.scale_rotations[i];
            *shape = [shape[0] - s0, shape[1] - s1, shape[2] - s2];
            let floor = step.rates.min_scale.ln();
            for scale in &mut shape[..2] {
                // NaN stays: it must be seen and pruned.
                if *scale < floor {
                    *scale = floor;
                }
            }
        }
        if let Some(logit) = slices.opacity_logits.get_mut(i) {
            let [m, v] = &mut slices.opacity_moments[i];
            let (g, rate) = (gradient.opacity_logit, step.rates.opacity);
            *m = rate.beta1 * *m + (1.0 - rate.beta1) * g;
            *v = rate.beta2 * *v + (1.0 - rate.beta2) * g * g;
            *logit -=
                rate.learning_rate * (*m * bias.opacity[0]) / ((*v * bias.opacity[1]).sqrt() + step.rates.epsilon);
        }
        if step.collect && gradient.visible {
            slices.gradient_sum[i] += gradient.device_norm;
            slices.visible[i] = slices.visible[i].saturating_add(1);
        }
    }
}

/// L (I + η + η²/2) with η = −`moved` (η₀₀, η₀₁, η₁₁), no scale below `min_scale`.
#[inline(always)]
fn turn(l: Mat2, moved: [f32; 3], min_scale: f32) -> Mat2 {
    let [a, b, d] = moved.map(|v| (-v).clamp(-MAX_ETA, MAX_ETA));
    // I + η + η²/2, symmetric.
    let b2 = b * b;
    let (xx, yy) = (1.0 + a + 0.5 * (a * a + b2), 1.0 + d + 0.5 * (d * d + b2));
    let xy = b + 0.5 * b * (a + d);
    let l = Mat2::from_cols(l.x_axis * xx + l.y_axis * xy, l.x_axis * xy + l.y_axis * yy);
    // The smaller scale is |det|/(the larger), and the larger is at most the Frobenius norm.
    let frobenius = (l.x_axis.length_squared() + l.y_axis.length_squared()).sqrt();
    if l.determinant().abs() < min_scale * frobenius { floored(l, min_scale) } else { l }
}

/// L with its scales raised to at least `min_scale`, its axes and its right-hand rotation as they are.
#[cold]
fn floored(l: Mat2, min_scale: f32) -> Mat2 {
    let (log_scale, angle) = PlanarGaussian::shape_of_frame(l);
    let scale = log_scale.map(f32::exp);
    if !(scale.y < min_scale) || !angle.is_finite() {
        return l;
    }
    let (sin, cos) = angle.sin_cos();
    let axes = Mat2::from_cols(Vec2::new(cos, sin), Vec2::new(-sin, cos));
    let raised = scale.max(Vec2::splat(min_scale));
    // L = U S Vᵀ; U S′ Vᵀ = U (S′/S) Uᵀ L, but S may be 0: then V is taken as the identity.
    let factor = raised / scale;
    if factor.is_finite() {
        axes * Mat2::from_diagonal(factor) * axes.transpose() * l
    } else {
        axes * Mat2::from_diagonal(raised)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_scale_falls_below_the_floor() {
        let needle = Mat2::from_angle(0.7) * Mat2::from_diagonal(Vec2::new(9.0, 0.26)) * Mat2::from_angle(-1.1);
        let turned = turn(needle, [0.4, -0.3, 0.45], 0.25);
        let (log_scale, _) = PlanarGaussian::shape_of_frame(turned);
        assert!(log_scale.y.exp() > 0.2499, "{}", log_scale.y.exp());
        let (log_scale, _) = PlanarGaussian::shape_of_frame(floored(Mat2::from_cols(Vec2::X, Vec2::X), 0.25));
        assert!(log_scale.y.exp() > 0.2499);
        assert!(turn(Mat2::NAN, [0.0; 3], 0.25).is_nan());
    }
}
