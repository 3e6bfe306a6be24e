//! Stage `adam`: one step of every Gaussian, in eight lanes (mean 2, shape 3, colour 3), and its
//! statistics. Parallel over Gaussians.

use std::ops::Range;

use fearless_simd::{Simd, f32x8, prelude::*};
use glam::{DMat2, DVec2, Mat2, Vec2};
use gs_core::{
    AdamRates, Gaussian2d, Participants,
    constants::{MAX_DERIVATIVE, MAX_ETA, MAX_XI, VANISHING_MOMENT},
    effects::Statistics,
};

use super::{
    buffers::Gradient,
    splats::{Shapes, Splats2d, VECTOR},
};
use crate::{
    bias::BiasTable,
    lanes::{bound_scales, bounded_derivative},
    level::{Level, dispatch},
    splat::CHUNK,
};

/// Adam's settings, lane by lane.
#[derive(Debug, Clone, Copy)]
struct LaneRates {
    rate: [f32; VECTOR],
    beta1: [f32; VECTOR],
    beta2: [f32; VECTOR],
}

fn lane_rates(rates: &AdamRates, splats: &Splats2d) -> LaneRates {
    let third = match splats.shapes {
        Shapes::ScaleRotation(_) => rates.rotation,
        Shapes::CovarianceFactor(_) => rates.scale,
    };
    let groups = [rates.mean, rates.mean, rates.scale, rates.scale, third, rates.color, rates.color, rates.color];
    LaneRates { rate: groups.map(|g| g.learning_rate), beta1: groups.map(|g| g.beta1), beta2: groups.map(|g| g.beta2) }
}

/// A range of the splats' arrays.
struct Slices<'a> {
    means: &'a mut [Vec2],
    scale_rotations: &'a mut [[f32; 3]],
    factors: &'a mut [Mat2],
    colors: &'a mut [[f32; 3]],
    opacity_logits: &'a mut [f32],
    first: &'a mut [[f32; VECTOR]],
    second: &'a mut [[f32; VECTOR]],
    opacity_moments: &'a mut [[f32; 2]],
    steps: &'a mut [u32],
    signal_sum: &'a mut [f32],
    visible: &'a mut [u32],
}

impl Slices<'_> {
    fn split(self, at: usize) -> (Self, Self) {
        /// Cuts every field at `at`. Unused fields are empty.
        macro_rules! cut {
            ($($field:ident),*) => {{
                $(let $field = self.$field.split_at_mut(at.min(self.$field.len()));)*
                (Self { $($field: $field.0),* }, Self { $($field: $field.1),* })
            }};
        }
        cut!(
            means,
            scale_rotations,
            factors,
            colors,
            opacity_logits,
            first,
            second,
            opacity_moments,
            steps,
            signal_sum,
            visible
        )
    }
}

/// The arguments of a step that all Gaussians share.
struct Step<'a> {
    lanes: LaneRates,
    rates: &'a AdamRates,
    bias: &'a BiasTable<{ VECTOR + 1 }>,
    collect: bool,
}

/// Takes one Adam step along `gradient_of(index)`, and adds to the statistics if they are
/// collected.
pub(crate) fn step<'g>(
    splats: &mut Splats2d,
    table: &mut BiasTable<{ VECTOR + 1 }>,
    rates: &AdamRates,
    level: Level,
    statistics: Statistics,
    gradient_of: impl Fn(usize) -> &'g Gradient + Sync,
) {
    let lanes = lane_rates(rates, splats);
    // The eight lanes, then the opacity.
    let group = |k: usize| {
        if k < VECTOR { [lanes.beta1[k], lanes.beta2[k]] } else { [rates.opacity.beta1, rates.opacity.beta2] }
    };
    table.prepare(std::array::from_fn(group), &splats.steps);
    let step = Step { lanes, rates, bias: table, collect: statistics != Statistics::None };
    let count = splats.shared.len();
    let Splats2d { means, shapes, colors, opacity_logits, moments: [first, second], opacity_moments, .. } = splats;
    let (scale_rotations, factors): (&mut [_], &mut [_]) = match shapes {
        Shapes::ScaleRotation(shapes) => (shapes, &mut []),
        Shapes::CovarianceFactor(factors) => (&mut [], factors),
    };
    let slices = Slices {
        means,
        scale_rotations,
        factors,
        colors,
        opacity_logits,
        first,
        second,
        opacity_moments,
        steps: &mut splats.steps,
        signal_sum: &mut splats.shared.statistics.signal_sum,
        visible: &mut splats.shared.statistics.visible,
    };
    divide(slices, 0..count, &step, level, &gradient_of);
}

fn divide<'g>(
    slices: Slices<'_>,
    indices: Range<usize>,
    step: &Step<'_>,
    level: Level,
    gradient_of: &(impl Fn(usize) -> &'g Gradient + Sync),
) {
    if indices.len() <= CHUNK {
        dispatch!(level, simd => step_all(simd, slices, indices, step, gradient_of));
        return;
    }
    let half = indices.len() / 2;
    let middle = indices.start + half;
    let (left, right) = slices.split(half);
    rayon::join(
        || divide(left, indices.start..middle, step, level, gradient_of),
        || divide(right, middle..indices.end, step, level, gradient_of),
    );
}

#[inline(always)]
fn step_all<'g, S: Simd>(
    simd: S,
    slices: Slices<'_>,
    indices: Range<usize>,
    step: &Step<'_>,
    gradient_of: &impl Fn(usize) -> &'g Gradient,
) {
    let local = slices.scale_rotations.is_empty();
    let lane = |values: [f32; VECTOR]| f32x8::load_array(simd, values);
    let (rate, beta1, beta2) = (lane(step.lanes.rate), lane(step.lanes.beta1), lane(step.lanes.beta2));
    let (rest1, rest2) = (1.0 - beta1, 1.0 - beta2);
    let (zero, epsilon) = (f32x8::splat(simd, 0.0), f32x8::splat(simd, step.rates.epsilon));
    let vanishing = f32x8::splat(simd, VANISHING_MOMENT);
    for (i, index) in indices.enumerate() {
        let gradient = gradient_of(index);
        let out_of_step = !gradient.visible && step.rates.participants == Participants::Visible;
        if out_of_step || index < step.rates.fixed as usize {
            continue;
        }
        let (by_mean, by_shape) = if local {
            (gradient.xi, gradient.eta)
        } else if gradient.visible {
            let [x, y, angle] = slices.scale_rotations[i];
            let (sin, cos) = angle.sin_cos();
            let l = Mat2::from_cols(Vec2::new(cos, sin) * x.exp(), Vec2::new(-sin, cos) * y.exp());
            gradient.whitened().by_scale_rotation(l, x - y)
        } else {
            (Vec2::ZERO, [0.0; 3])
        };
        let [r, g, b] = gradient.color;
        let g = lane([by_mean.x, by_mean.y, by_shape[0], by_shape[1], by_shape[2], r, g, b]);
        let g = bounded_derivative(simd, g);
        slices.steps[i] = slices.steps[i].saturating_add(1);
        let bias = step.bias.at(slices.steps[i]);
        let (first, second) =
            (f32x8::from_slice(simd, &bias.first[..VECTOR]), f32x8::from_slice(simd, &bias.second[..VECTOR]));

        let m = lane(slices.first[i]).mul_add(beta1, g * rest1);
        let m = m.abs().simd_lt(vanishing).select(zero, m);
        let v = lane(slices.second[i]).mul_add(beta2, g * g * rest2);
        m.store_array(&mut slices.first[i]);
        v.store_array(&mut slices.second[i]);
        let moved = rate * (m * first) / ((v * second).sqrt() + epsilon);
        let moved: [f32; VECTOR] = moved.into();

        let [u, w, s0, s1, s2, colors @ ..] = moved;
        for k in 0..3 {
            slices.colors[i][k] -= colors[k];
        }
        if local {
            let l = slices.factors[i];
            slices.means[i] -= l * Vec2::new(u.clamp(-MAX_XI, MAX_XI), w.clamp(-MAX_XI, MAX_XI));
            slices.factors[i] = turn(l, [s0, s1, s2], step.rates);
        } else {
            slices.means[i] -= Vec2::new(u, w);
            let shape = &mut slices.scale_rotations[i];
            *shape = [shape[0] - s0, shape[1] - s1, shape[2] - s2];
            bound_scales(&mut shape[..2], [step.rates.min_scale.ln(), step.rates.max_scale.ln()]);
        }
        if let Some(logit) = slices.opacity_logits.get_mut(i) {
            let [m, v] = &mut slices.opacity_moments[i];
            let g = gradient.opacity_logit;
            let is_large = g.abs() > MAX_DERIVATIVE;
            let g = if is_large { MAX_DERIVATIVE.copysign(g) } else { g };
            let rate = step.rates.opacity;
            *m = rate.beta1 * *m + (1.0 - rate.beta1) * g;
            *v = rate.beta2 * *v + (1.0 - rate.beta2) * g * g;
            *logit -= rate.learning_rate * (*m * bias.first[VECTOR])
                / ((*v * bias.second[VECTOR]).sqrt() + step.rates.epsilon);
        }
        if step.collect && gradient.visible {
            gradient.share.add_to(&mut slices.signal_sum[i], &mut slices.visible[i]);
        }
    }
}

/// L (I + η + η²/2) with η = −`moved` (η₀₀, η₀₁, η₁₁), and scales within their bounds.
#[inline(always)]
fn turn(l: Mat2, moved: [f32; 3], rates: &AdamRates) -> Mat2 {
    let [a, b, d] = moved;
    let [a, b, d] = [(-a).clamp(-MAX_ETA, MAX_ETA), (-b).clamp(-MAX_ETA, MAX_ETA), (-d).clamp(-MAX_ETA, MAX_ETA)];
    // I + η + η²/2, symmetric.
    let b2 = b * b;
    let (xx, yy) = (1.0 + a + 0.5 * (a * a + b2), 1.0 + d + 0.5 * (d * d + b2));
    let xy = b + 0.5 * b * (a + d);
    let l = Mat2::from_cols(l.x_axis * xx + l.y_axis * xy, l.x_axis * xy + l.y_axis * yy);
    // Sum and product of the squared scales. If the smaller is `floor`, the other is sum − floor.
    let (sum, product) = (l.x_axis.length_squared() + l.y_axis.length_squared(), l.determinant().powi(2));
    let floor = rates.min_scale * rates.min_scale;
    let is_small = product < floor * (sum - floor) || sum < 2.0 * floor;
    let is_large = sum > rates.max_scale * rates.max_scale;
    if is_small || is_large { bounded(l, rates) } else { l }
}

/// L with its scales clamped to their bounds, and its axes and right-hand rotation unchanged.
///
/// Computed in `f64`, because det L of a needle cancels in `f32`.
#[cold]
fn bounded(l: Mat2, rates: &AdamRates) -> Mat2 {
    let wide = l.as_dmat2();
    // L = U S Vᵀ, and L Lᵀ = U S² Uᵀ = ½ (S₀² + S₁²) I + ½ (S₀² − S₁²) R, where R is the reflection
    // at the first axis.
    let square = wide * wide.transpose();
    let mean = 0.5 * (square.x_axis.x + square.y_axis.y);
    let mirror = square - DMat2::from_diagonal(DVec2::splat(mean));
    let spread = mirror.x_axis.length();
    let large = (mean + spread).sqrt();
    let scale = DVec2::new(large, wide.determinant().abs() / large);
    let within = scale.clamp(DVec2::splat(rates.min_scale.into()), DVec2::splat(rates.max_scale.into()));
    if within == scale {
        return l;
    }
    // U S′ Vᵀ = U (S′/S) Uᵀ L, but S may be 0.
    let factor = within / scale;
    if !factor.is_finite() {
        return bounded_without_inverse(l, rates);
    }
    let along = if spread > 0.0 { 0.5 * (factor.x - factor.y) / spread } else { 0.0 };
    let stretch = DMat2::from_diagonal(DVec2::splat(0.5 * (factor.x + factor.y))) + mirror * along;
    (stretch * wide).as_mat2()
}

/// [`bounded`] for an S with a zero or a number that is not finite: it uses V = I.
fn bounded_without_inverse(l: Mat2, rates: &AdamRates) -> Mat2 {
    let (log_scale, angle) = Gaussian2d::shape_of_factor(l);
    let within = log_scale.map(f32::exp).clamp(Vec2::splat(rates.min_scale), Vec2::splat(rates.max_scale));
    if angle.is_finite() { Mat2::from_angle(angle) * Mat2::from_diagonal(within) } else { l }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_stay_within_their_bounds() {
        let rates = gs_core::Adam::default()
            .with(|s| {
                s.min_scale = 0.25;
                s.max_scale = 10.0;
            })
            .at(0.0);
        let scales = |l| Gaussian2d::shape_of_factor(l).0.map(f32::exp);
        let needle = Mat2::from_angle(0.7) * Mat2::from_diagonal(Vec2::new(9.9, 0.26)) * Mat2::from_angle(-1.1);
        for moved in [[0.4, -0.3, 0.45], [-0.4, 0.3, -0.45], [-0.5, 0.0, 0.5]] {
            let scale = scales(turn(needle, moved, &rates));
            assert!(scale.y > 0.2499 && scale.x < 10.01, "{scale}");
        }
        let scale = scales(bounded(Mat2::from_cols(Vec2::X, Vec2::X), &rates));
        assert!(scale.y > 0.2499);
        // The axes, the other scale and the right-hand rotation do not change.
        let [axes, turned] = [0.7, -1.1].map(Mat2::from_angle);
        for (scale, within) in [([5.0, 0.01], [5.0, 0.25]), ([4e4, 1e-3], [10.0, 0.25]), ([0.1, 0.1], [0.25, 0.25])] {
            let [found, expected] = [scale, within].map(|s| axes * Mat2::from_diagonal(s.into()) * turned);
            let found = bounded(found, &rates);
            assert!(found.abs_diff_eq(expected, 1e-6 * within[0]), "{scale:?}: {found} instead of {expected}");
        }
        let scale = scales(turn(Mat2::ZERO, [0.0; 3], &rates));
        assert!((scale - 0.25).abs().max_element() < 1e-6, "a zero factor without a gradient: {scale}");
        assert!(turn(Mat2::NAN, [0.0; 3], &rates).is_nan());
    }
}
