//! The kernels of stage `loss` for losses that are sums over pixels and channels: L1 and L2.

use fearless_simd::{Simd, prelude::*};
use gs_core::constants::MAX_RESIDUAL;

use crate::{
    lanes::{LANES, Whole, fma, iota, load, splat, splat3, store},
    layout::Row,
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

/// Writes the gradients of a tile into `v_rows`; returns the sum of the losses.
#[inline(always)]
pub(crate) fn each<S: Simd>(
    simd: S,
    image: &[Row],
    target: &[Row],
    v_rows: &mut [Row],
    inside: usize,
    kind: Pointwise,
) -> f64 {
    let mut total = 0.0;
    for ((Row(c), Row(y)), Row(v)) in image.iter().zip(target).zip(&mut *v_rows) {
        let mut losses: Whole<S> = splat(simd, 0.0);
        for k in 0..3 {
            let (loss, gradient) = kind.of(simd, residual(simd, &c[k], &y[k], inside));
            losses += loss;
            store(gradient, &mut v[k], 0);
        }
        total += f64::from(losses.reduce_sum());
    }
    if let Pointwise::Square { scale } = kind {
        bound_residuals(v_rows, scale, total);
    }
    total
}

/// Subtracts the target from a tile's values, and clamps the residuals as L2 does.
///
/// Returns the sum of the squares before clamping.
#[inline(always)]
pub(crate) fn squares_in_place<S: Simd>(simd: S, rows: &mut [Row], target: &[Row], inside: usize) -> f64 {
    let mut total = 0.0;
    for (Row(c), Row(y)) in rows.iter_mut().zip(target) {
        let mut squares: Whole<S> = splat(simd, 0.0);
        for (c, y) in c.iter_mut().zip(y) {
            let residual = residual(simd, c, y, inside);
            squares = fma(residual, residual, squares);
            store(residual, c, 0);
        }
        total += f64::from(squares.reduce_sum());
    }
    bound_residuals(rows, 1.0, total);
    total
}
