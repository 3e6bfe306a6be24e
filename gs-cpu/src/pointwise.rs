//! The kernels of stage `loss` for losses that are sums over pixels and channels: L1 and L2.

use fearless_simd::{Simd, prelude::*};
use gs_core::constants::MAX_RESIDUAL;

use crate::{
    lanes::{LANES, Whole, fma, iota, load, splat, splat3, store},
    layout::{Row, ScalarRow},
};

/// A loss that is a sum over pixels and channels. `scale` is the factor of its gradient.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Pointwise {
    Square { scale: f32 },
    Absolute { scale: f32 },
}

impl Pointwise {
    /// The losses of residuals C − Y, and their gradients. Both are 0 for a residual of 0.
    #[inline(always)]
    pub(crate) fn of<S: Simd>(self, simd: S, residual: Whole<S>) -> (Whole<S>, Whole<S>) {
        match self {
            Self::Square { scale } => (residual * residual, residual * scale),
            Self::Absolute { scale } => {
                let [zero, below, above] = splat3(simd, [0.0, -scale, scale]);
                let sign = residual.simd_lt(zero).select(below, zero);
                (residual.abs(), residual.simd_gt(zero).select(above, sign))
            }
        }
    }
}

/// C − Y of one channel of a row; 0 in lanes beyond the image.
#[inline(always)]
fn residual<S: Simd>(simd: S, c: &[f32; LANES], y: &[f32; LANES], inside: usize) -> Whole<S> {
    let [c, y]: [Whole<S>; 2] = [load(simd, c, 0), load(simd, y, 0)];
    let (column, columns): (Whole<S>, Whole<S>) = (iota(simd, 0), splat(simd, inside as f32));
    column.simd_lt(columns).select(c - y, splat(simd, 0.0))
}

/// Clamps `scale` times residuals to `scale` times ±[`MAX_RESIDUAL`]; NaN stays.
///
/// `squares` is the sum of the residuals' squares.
#[inline(always)]
fn bound_residuals(scaled: &mut [Row], scale: f32, squares: f64) {
    // No residual is larger than the root of the sum, so this loop almost never runs.
    let (bound, most) = (f64::from(MAX_RESIDUAL), MAX_RESIDUAL * scale);
    if !(squares <= bound * bound) {
        let values = scaled.iter_mut().flat_map(|Row(channels)| channels.as_flattened_mut());
        values.for_each(|value| *value = value.clamp(-most, most));
    }
}

/// The rows of a tile that a loss compares.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Compared<'a> {
    /// Rows of the target.
    pub(crate) target: &'a [Row],
    /// Rows of the pixels' weights; empty where all count the same.
    pub(crate) weights: &'a [ScalarRow],
    /// Lanes inside the image.
    pub(crate) inside: usize,
}

/// Writes the gradients of a tile into `v_rows`; returns the sum of the losses.
#[inline(always)]
pub(crate) fn each<S: Simd>(
    simd: S,
    image: &[Row],
    Compared { target, weights, inside }: Compared<'_>,
    v_rows: &mut [Row],
    kind: Pointwise,
) -> f64 {
    let (mut total, mut weighted) = (0.0, 0.0);
    for (at, ((Row(c), Row(y)), Row(v))) in image.iter().zip(target).zip(&mut *v_rows).enumerate() {
        let mut losses: Whole<S> = splat(simd, 0.0);
        for k in 0..3 {
            let (loss, gradient) = kind.of(simd, residual(simd, &c[k], &y[k], inside));
            losses += loss;
            store(gradient, &mut v[k], 0);
        }
        total += f64::from(losses.reduce_sum());
        if let Some(ScalarRow(weights)) = weights.get(at) {
            weighted += f64::from((losses * load::<S, Whole<S>>(simd, weights, 0)).reduce_sum());
        }
    }
    if let Pointwise::Square { scale } = kind {
        bound_residuals(v_rows, scale, total);
    }
    weigh(simd, v_rows, weights);
    if weights.is_empty() { total } else { weighted }
}

/// Subtracts the target from a tile's values, clamps the residuals as L2 does, and multiplies them by
/// the weights.
///
/// Returns the weighted sum of the squares before clamping.
#[inline(always)]
pub(crate) fn squares_in_place<S: Simd>(
    simd: S,
    rows: &mut [Row],
    Compared { target, weights, inside }: Compared<'_>,
) -> f64 {
    let (mut total, mut weighted) = (0.0, 0.0);
    for (at, (Row(c), Row(y))) in rows.iter_mut().zip(target).enumerate() {
        let mut squares: Whole<S> = splat(simd, 0.0);
        for (c, y) in c.iter_mut().zip(y) {
            let residual = residual(simd, c, y, inside);
            squares = fma(residual, residual, squares);
            store(residual, c, 0);
        }
        total += f64::from(squares.reduce_sum());
        if let Some(ScalarRow(weights)) = weights.get(at) {
            weighted += f64::from((squares * load::<S, Whole<S>>(simd, weights, 0)).reduce_sum());
        }
    }
    bound_residuals(rows, 1.0, total);
    weigh(simd, rows, weights);
    if weights.is_empty() { total } else { weighted }
}

/// Multiplies rows by the weights of their pixels; an empty slice leaves the rows as they are.
#[inline(always)]
pub(crate) fn weigh<S: Simd>(simd: S, rows: &mut [Row], weights: &[ScalarRow]) {
    for (Row(channels), ScalarRow(weights)) in rows.iter_mut().zip(weights) {
        let weights: Whole<S> = load(simd, weights, 0);
        for channel in channels {
            let values: Whole<S> = load(simd, channel, 0);
            store(values * weights, channel, 0);
        }
    }
}
