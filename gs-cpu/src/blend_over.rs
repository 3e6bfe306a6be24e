//! Stages `blend` and `blend_bwd` under `Over`: C = Σ T α c, front to back. One task per tile, one vector per row of 16 pixels.
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
    blend_sum::{Weights, u_in_row},
    lanes::{Lanes, load3, splat, splat3, sums},
    layout::{Row, ScalarRow},
    project::Splat,
};

/// Numbers per entry that [`backward`] yields: those of `Sum`, and S (the sum of t).
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
    let zero = splat(simd, 0.0);
    let alpha_max = splat(simd, accuracy.alpha_max);
    let minimum = splat(simd, accuracy.transmittance_min);
    for entry in entries {
        let s = &splats[entry.place as usize];
        let mut weights = Weights::new(simd, s, first_column);
        let (cut, opacity) = (splat(simd, s.cut), splat(simd, s.opacity));
        let color = splat3(simd, s.color);
        let [mut row, end] = entry.rows.map(usize::from);
        while row < end {
            let stop = end.min(row + s.restart_rows as usize);
            weights.start(simd, u_in_row(simd, s, weights.dx, row));
            let range = row - first_row..stop - first_row;
            for (Row(pixels), ScalarRow(t)) in rows[range.clone()].iter_mut().zip(&mut transmittance[range]) {
                let uncut = weights.w * opacity;
                let alpha = uncut.min(alpha_max);
                let before = Lanes::load_array_ref(simd, t);
                let share = before * alpha;
                let behind = before - share;
                let touches = uncut.simd_ge(cut);
                let counts = behind.simd_ge(minimum);
                let after = counts.select(behind, -before.abs());
                touches.select(after, before).store_array(t);
                let share = (touches & counts).select(share, zero);
                for k in 0..3 {
                    let sum = share.mul_add(color[k], Lanes::load_array_ref(simd, &pixels[k]));
                    sum.store_array(&mut pixels[k]);
                }
                weights.advance();
            }
            row = stop;
        }
    }
    for (Row(pixels), ScalarRow(t)) in rows.iter_mut().zip(transmittance) {
        let left = Lanes::load_array_ref(simd, t).abs();
        left.store_array(t);
        for k in 0..3 {
            let sum = left.mul_add(splat(simd, backdrop[k]), Lanes::load_array_ref(simd, &pixels[k]));
            sum.store_array(&mut pixels[k]);
        }
    }
}

/// What the entries' Gaussians receive from v_C = `v_rows`: [`STRIDE`] numbers per entry, into `slots`. `rows` holds the finished
/// colours, and is used up.
#[expect(clippy::too_many_arguments, reason = "a kernel's inputs are slices of different owners")]
#[inline(always)]
pub(crate) fn backward<S: Simd>(
    simd: S,
    entries: &[Entry],
    splats: &[Splat],
    accuracy: &Accuracy,
    first_column: usize,
    first_row: usize,
    rows: &mut [Row],
    v_rows: &[Row],
    slots: &mut [f32],
) {
    let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
    let alpha_max = splat(simd, accuracy.alpha_max);
    let minimum = splat(simd, accuracy.transmittance_min);
    for (Row(pixels), Row(v)) in rows.iter_mut().zip(v_rows) {
        // From here on, channel 0 is T and channel 1 the rest.
        let [r, g, b] = load3(simd, pixels);
        let [v_r, v_g, v_b] = load3(simd, v);
        one.store_array(&mut pixels[0]);
        b.mul_add(v_b, g.mul_add(v_g, r * v_r)).store_array(&mut pixels[1]);
    }
    for (entry, slot) in entries.iter().zip(slots.as_chunks_mut::<STRIDE>().0) {
        let s = &splats[entry.place as usize];
        let mut weights = Weights::new(simd, s, first_column);
        let (cut, opacity) = (splat(simd, s.cut), splat(simd, s.opacity));
        let color = splat3(simd, s.color);
        let (mut v_color, mut s_0, mut s_u, mut s_uu) = ([zero; 3], zero, zero, zero);
        let [mut row, end] = entry.rows.map(usize::from);
        while row < end {
            let stop = end.min(row + s.restart_rows as usize);
            let mut u = u_in_row(simd, s, weights.dx, row);
            weights.start(simd, u);
            let range = row - first_row..stop - first_row;
            for (Row([t, rest, _]), Row(v)) in rows[range.clone()].iter_mut().zip(&v_rows[range]) {
                let uncut = weights.w * opacity;
                let alpha = uncut.min(alpha_max);
                let before = Lanes::load_array_ref(simd, t);
                let share = before * alpha;
                let behind = before - share;
                let touches = uncut.simd_ge(cut);
                let counts = behind.simd_ge(minimum);
                let after = counts.select(behind, -before.abs());
                touches.select(after, before).store_array(t);
                let counted = touches & counts;
                let share = counted.select(share, zero);

                let v = load3(simd, v);
                for k in 0..3 {
                    v_color[k] = share.mul_add(v[k], v_color[k]);
                }
                let v_dot_c = v[2].mul_add(color[2], v[1].mul_add(color[1], v[0] * color[0]));
                let behind_it = Lanes::load_array_ref(simd, rest) - share * v_dot_c;
                behind_it.store_array(rest);
                let v_alpha = before * v_dot_c - behind_it / (one - alpha);
                // The gradient of a clamped α is zero.
                let free = counted & uncut.simd_le(alpha_max);
                let t = free.select(v_alpha * alpha, zero);
                let tu = t * u;
                s_0 += t;
                s_u += tu;
                s_uu = tu.mul_add(u, s_uu);
                u += 1.0;
                weights.advance();
            }
            row = stop;
        }
        let tx = s_0 * weights.dx;
        let eight = sums([v_color[0], v_color[1], v_color[2], tx, s_u, tx * weights.dx, s_u * weights.dx, s_uu]);
        slot[..8].copy_from_slice(&eight);
        slot[8] = s_0.reduce_sum();
    }
}
