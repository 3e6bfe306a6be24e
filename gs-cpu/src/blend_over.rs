//! Stages `blend` and `blend_bwd` under `Over`: C = Σ T α c, front to back. One task per tile; vectors as in
//! `blend_sum`.
//!
//! Entries are walked front to back in both directions. A pixel that is full keeps its transmittance with the sign turned, so that
//! every later Gaussian fails the test against the minimum. The backward pass keeps, per pixel, T and the rest v_C·(what is
//! behind), and never divides by less than 1 − α_max.
//!
//! Legend: as in `blend_sum`, with t = α·v_α.

use fearless_simd::{Simd, prelude::*};
use gs_core::Accuracy;

use crate::{
    bin::Entry,
    blend_sum::{Weights, add, add_absolute, add_collected, add_error, passes_by, u_in_row},
    collect::Collect,
    lanes::{Floats, LANES, each_part, fma, load, load3, splat, splat3, store, sums},
    layout::{Row, ScalarRow},
    splat::Splat,
};

/// Numbers per entry that [`backward`] yields: those of `Sum`, and S (the sum of t). Those that K asks for follow them.
pub(crate) const STRIDE: usize = 9;

/// Blends the entries' Gaussians into `rows` (which start at 0) and `transmittance` (which starts at 1), before `backdrop`.
#[expect(clippy::too_many_arguments, reason = "a kernel's inputs are slices of different owners")]
#[inline(always)]
pub(crate) fn forward<S: Simd>(
    simd: S,
    entries: &[Entry],
    splats: &[Splat],
    accuracy: &Accuracy,
    first_column: usize,
    first_row: usize,
    rows: &mut [Row],
    transmittance: &mut [ScalarRow],
    backdrop: [f32; 3],
) {
    for entry in entries {
        let s = &splats[entry.place as usize];
        let [row, end] = entry.rows.map(|row| usize::from(row) - first_row);
        let (rows, transmittance) = (&mut rows[row..end], &mut transmittance[row..end]);
        each_part!(S; forward_part(simd, s, accuracy, first_column, usize::from(entry.rows[0]), rows, transmittance));
    }
    for (Row(pixels), ScalarRow(t)) in rows.iter_mut().zip(transmittance) {
        for lane in (0..LANES).step_by(S::f32s::LEN) {
            let left: S::f32s = load(simd, t, lane);
            let left = left.abs();
            store(left, t, lane);
            for k in 0..3 {
                let sum = fma(left, splat(simd, backdrop[k]), load(simd, &pixels[k], lane));
                store(sum, &mut pixels[k], lane);
            }
        }
    }
}

/// [`forward`] of one entry, in the lanes of one vector.
#[inline(always)]
fn forward_part<S: Simd, V: Floats<S>, const LANE: usize>(
    simd: S,
    s: &Splat,
    accuracy: &Accuracy,
    first_column: usize,
    mut row: usize,
    rows: &mut [Row],
    transmittance: &mut [ScalarRow],
) {
    if passes_by::<S, V>(s, first_column, LANE) {
        return;
    }
    let (zero, cut, opacity): (V, V, V) = (splat(simd, 0.0), splat(simd, s.cut), splat(simd, s.opacity));
    let (alpha_max, minimum): (V, V) = (splat(simd, accuracy.alpha_max), splat(simd, accuracy.transmittance_min));
    let color = splat3(simd, s.color);
    let mut weights = Weights::<V>::new(simd, s, first_column, LANE);
    let run = s.restart_rows as usize;
    for (rows, transmittance) in rows.chunks_mut(run).zip(transmittance.chunks_mut(run)) {
        weights.start(simd, u_in_row(simd, s, weights.dx, row));
        row += rows.len();
        for (Row(pixels), ScalarRow(t)) in rows.iter_mut().zip(transmittance) {
            let uncut = weights.w * opacity;
            let alpha = uncut.min(alpha_max);
            let before: V = load(simd, t, LANE);
            let share = before * alpha;
            let behind = before - share;
            let touches = uncut.simd_ge(cut);
            let counts = behind.simd_ge(minimum);
            let after = counts.select(behind, -before.abs());
            store(touches.select(after, before), t, LANE);
            let share = (touches & counts).select(share, zero);
            for k in 0..3 {
                store(fma(share, color[k], load(simd, &pixels[k], LANE)), &mut pixels[k], LANE);
            }
            weights.advance::<S>();
        }
    }
}

/// What the entries' Gaussians receive from v_C = `v_rows`: [`STRIDE`] numbers per entry and those that K asks for, into `slots`. `rows` holds
/// the finished colours, and is used up; `errors` are those of the pixels, where K asks for them.
#[expect(clippy::too_many_arguments, reason = "a kernel's inputs are slices of different owners")]
#[inline(always)]
pub(crate) fn backward<S: Simd, K: Collect>(
    simd: S,
    entries: &[Entry],
    splats: &[Splat],
    accuracy: &Accuracy,
    first_column: usize,
    first_row: usize,
    rows: &mut [Row],
    v_rows: &[Row],
    errors: &[ScalarRow],
    slots: &mut [f32],
) {
    for (Row(pixels), Row(v)) in rows.iter_mut().zip(v_rows) {
        // From here on, channel 0 is T and channel 1 the rest.
        for lane in (0..LANES).step_by(S::f32s::LEN) {
            let [r, g, b]: [S::f32s; 3] = load3(simd, pixels, lane);
            let [v_r, v_g, v_b]: [S::f32s; 3] = load3(simd, v, lane);
            store(splat::<S, S::f32s>(simd, 1.0), &mut pixels[0], lane);
            store(fma(b, v_b, fma(g, v_g, r * v_r)), &mut pixels[1], lane);
        }
    }
    for (entry, slot) in entries.iter().zip(slots.chunks_exact_mut(STRIDE + K::NUMBERS)) {
        let s = &splats[entry.place as usize];
        let first = usize::from(entry.rows[0]);
        let [row, end] = entry.rows.map(|row| usize::from(row) - first_row);
        let (rows, v_rows) = (&mut rows[row..end], &v_rows[row..end]);
        let errors = if K::ERROR { &errors[row..end] } else { &[] };
        slot.fill(0.0);
        each_part!(S, K; backward_part(simd, s, accuracy, first_column, first, rows, v_rows, errors, slot));
    }
}

/// [`backward`] of one entry, in the lanes of one vector.
#[expect(clippy::too_many_arguments, reason = "a kernel's inputs are slices of different owners")]
#[inline(always)]
fn backward_part<S: Simd, V: Floats<S>, K: Collect, const LANE: usize>(
    simd: S,
    s: &Splat,
    accuracy: &Accuracy,
    first_column: usize,
    mut row: usize,
    rows: &mut [Row],
    v_rows: &[Row],
    mut errors: &[ScalarRow],
    slot: &mut [f32],
) {
    if passes_by::<S, V>(s, first_column, LANE) {
        return;
    }
    let (zero, one): (V, V) = (splat(simd, 0.0), splat(simd, 1.0));
    let (cut, opacity): (V, V) = (splat(simd, s.cut), splat(simd, s.opacity));
    let (alpha_max, minimum): (V, V) = (splat(simd, accuracy.alpha_max), splat(simd, accuracy.transmittance_min));
    let color = splat3(simd, s.color);
    let mut weights = Weights::<V>::new(simd, s, first_column, LANE);
    let (mut v_color, mut s_0, mut s_u, mut s_uu) = ([zero; 3], zero, zero, zero);
    let across = weights.dx * s.inverse_xx;
    let mut collected = [zero; 2];
    let run = s.restart_rows as usize;
    for (rows, v_rows) in rows.chunks_mut(run).zip(v_rows.chunks(run)) {
        let mut u = u_in_row(simd, s, weights.dx, row);
        weights.start(simd, u);
        row += rows.len();
        for (Row([t, rest, _]), Row(v)) in rows.iter_mut().zip(v_rows) {
            let uncut = weights.w * opacity;
            let alpha = uncut.min(alpha_max);
            let before: V = load(simd, t, LANE);
            let share = before * alpha;
            let behind = before - share;
            let touches = uncut.simd_ge(cut);
            let counts = behind.simd_ge(minimum);
            let after = counts.select(behind, -before.abs());
            store(touches.select(after, before), t, LANE);
            let counted = touches & counts;
            let share = counted.select(share, zero);

            let v = load3(simd, v, LANE);
            for k in 0..3 {
                v_color[k] = fma(share, v[k], v_color[k]);
            }
            let v_dot_c = fma(v[2], color[2], fma(v[1], color[1], v[0] * color[0]));
            let rest_before: V = load(simd, rest, LANE);
            let behind_it = rest_before - share * v_dot_c;
            store(behind_it, rest, LANE);
            let v_alpha = before * v_dot_c - behind_it / (one - alpha);
            // The gradient of a clamped α is zero.
            let free = counted & uncut.simd_le(alpha_max);
            let t = free.select(v_alpha * alpha, zero);
            let tu = t * u;
            s_0 += t;
            s_u += tu;
            s_uu = fma(tu, u, s_uu);
            if K::ABSOLUTE {
                add_absolute(&mut collected, t, across, u, s);
            }
            if K::ERROR {
                errors = add_error(simd, &mut collected, share, errors, LANE);
            }
            u += 1.0;
            weights.advance::<S>();
        }
    }
    let (slot, extra) = slot.split_at_mut(STRIDE);
    add_collected::<S, V, K>(extra, collected);
    let tx = s_0 * weights.dx;
    let eight = [v_color[0], v_color[1], v_color[2], tx, s_u, tx * weights.dx, s_u * weights.dx, s_uu];
    add(&mut slot[..8], &sums(eight));
    slot[8] += s_0.reduce_sum();
}
