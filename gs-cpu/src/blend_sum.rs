//! Stages `blend` and `blend_bwd` under `Sum`: C = Σ w c. One task per tile.
//!
//! What a Gaussian does at a vector of pixels is in `at_pixel`, with the legend; here t = w·v_w.

use fearless_simd::{Simd, prelude::*};

use crate::{
    at_pixel::{Weights, add, add_absolute, add_collected, add_error, passes_by, u_in_row},
    bin::Entry,
    collect::Collect,
    lanes::{Floats, LANES, Whole, each_part, fma, iota, load, load3, splat, splat3, store, sums},
    layout::{Row, ScalarRow},
    slots::Slots,
    splat::Splat,
};

/// Numbers per entry that [`backward`] writes: v_colour 3, Sx, Su, Sxx, Sxu, Suu. Those of K
/// follow.
pub(crate) const STRIDE: usize = 8;

/// Numbers per entry that [`backward_colors`] writes: v_colour 3, and a 0.
pub(crate) const COLOR_STRIDE: usize = 4;

/// Fills `rows` with background − target, from which [`forward`] computes the residual.
#[inline(always)]
pub(crate) fn start<S: Simd>(simd: S, background: [f32; 3], target: &[Row], rows: &mut [Row]) {
    let background: [S::f32s; 3] = splat3(simd, background);
    for (Row(pixels), Row(target)) in rows.iter_mut().zip(target) {
        for k in 0..3 {
            for lane in (0..LANES).step_by(S::f32s::LEN) {
                store(background[k] - load::<S, S::f32s>(simd, &target[k], lane), &mut pixels[k], lane);
            }
        }
    }
}

/// Adds the entries' Gaussians to `rows`; the first of `rows` is image row `first_row`.
///
/// A run is the rows between two starts of the recurrence. Each run's start is computed before the
/// rows of the previous run, across entries: the exponentials then do not wait for a mispredicted
/// end of a run.
#[inline(always)]
pub(crate) fn forward<S: Simd>(
    simd: S,
    entries: &[Entry],
    projected: &[Splat],
    first_column: usize,
    first_row: usize,
    rows: &mut [Row],
) {
    let Some(first) = entries.first() else { return };
    let mut run = Run::<Whole<S>>::new(simd, first, projected, first_column, usize::from(first.rows[0]));
    for (index, entry) in entries.iter().enumerate() {
        let s = &projected[entry.splat as usize];
        let color: [Whole<S>; 3] = splat3(simd, s.color);
        let following = entries.get(index + 1).unwrap_or(entry);
        let end = usize::from(entry.rows[1]);
        loop {
            let stop = (run.row + s.restart_rows as usize).min(end);
            let (of, at) = if stop < end { (entry, stop) } else { (following, usize::from(following.rows[0])) };
            let next = Run::new(simd, of, projected, first_column, at);
            let mut weights = run.weights;
            for Row(pixels) in &mut rows[run.row - first_row..stop - first_row] {
                let (w, _) = weights.above(simd, s);
                for k in 0..3 {
                    store(fma(w, color[k], load(simd, &pixels[k], 0)), &mut pixels[k], 0);
                }
                weights.advance::<S>();
            }
            run = next;
            if stop == end {
                break;
            }
        }
    }
}

/// A start of the recurrence, computed ahead of its rows.
#[derive(Clone, Copy)]
struct Run<V> {
    row: usize,
    weights: Weights<V>,
}

impl<V> Run<V> {
    #[inline(always)]
    fn new<S: Simd>(simd: S, entry: &Entry, projected: &[Splat], first_column: usize, row: usize) -> Self
    where
        V: Floats<S>,
    {
        let s = &projected[entry.splat as usize];
        let mut weights = Weights::<V>::new(simd, s, first_column, 0);
        weights.start(simd, u_in_row(simd, s, weights.dx, row));
        Self { row, weights }
    }
}

/// Computes the entries' gradients from v_C = `rows` into `slots`.
///
/// A slot has [`STRIDE`] numbers, and those of K. `errors` are the pixels' errors if K needs them.
#[expect(clippy::too_many_arguments, reason = "a kernel's inputs are slices of different owners")]
#[inline(always)]
pub(crate) fn backward<S: Simd, K: Collect>(
    simd: S,
    entries: &[Entry],
    projected: &[Splat],
    first_column: usize,
    first_row: usize,
    lanes_inside: usize,
    rows: &[Row],
    errors: &[ScalarRow],
    slots: &Slots,
) {
    for entry in entries {
        let s = &projected[entry.splat as usize];
        let [row, end] = entry.rows.map(|row| usize::from(row) - first_row);
        let mut slot = [0.0; STRIDE + 2];
        let errors = if K::ERROR { &errors[row..end] } else { &[] };
        each_part!(S, K; backward_part(simd, s, [first_column, lanes_inside], usize::from(entry.rows[0]), &rows[row..end], errors, &mut slot));
        slots.put(entry.slot, &slot[..STRIDE + K::NUMBERS]);
    }
}

/// [`backward`] of one entry, in the lanes of one vector.
#[expect(clippy::too_many_arguments, reason = "a kernel's inputs are slices of different owners")]
#[inline(always)]
fn backward_part<S: Simd, V: Floats<S>, K: Collect>(
    simd: S,
    s: &Splat,
    [first_column, lanes_inside]: [usize; 2],
    mut row: usize,
    rows: &[Row],
    mut errors: &[ScalarRow],
    slot: &mut [f32],
    lane: usize,
) {
    if passes_by::<S, V>(s, first_column, lane) {
        return;
    }
    let zero: V = splat(simd, 0.0);
    let color = splat3(simd, s.color);
    let mut weights = Weights::<V>::new(simd, s, first_column, lane);
    let (mut v_color, mut s_u, mut s_uu) = ([zero; 3], zero, zero);
    let across = weights.dx * s.inverse_xx;
    let mut collected = [zero; 2];
    let inside = iota::<S, V>(simd, lane).simd_lt(splat::<S, V>(simd, lanes_inside as f32));
    for rows in rows.chunks(s.restart_rows as usize) {
        let mut u = u_in_row(simd, s, weights.dx, row);
        weights.start(simd, u);
        row += rows.len();
        for Row(v) in rows {
            let (w, counts) = weights.above(simd, s);
            let v = load3(simd, v, lane);
            for k in 0..3 {
                v_color[k] = fma(w, v[k], v_color[k]);
            }
            let v_w = fma(v[2], color[2], fma(v[1], color[1], v[0] * color[0]));
            let tu = w * v_w * u;
            s_u += tu;
            s_uu = fma(tu, u, s_uu);
            if K::ABSOLUTE {
                add_absolute(&mut collected, w * v_w, across, u, s);
            }
            if K::ERROR {
                errors = add_error(simd, &mut collected, w, errors, lane);
            }
            if K::COUNT {
                collected[0] += (counts & inside).select(splat::<S, V>(simd, 1.0), zero);
            }
            u += 1.0;
            weights.advance::<S>();
        }
    }
    let (slot, extra) = slot.split_at_mut(STRIDE);
    add_collected::<S, V, K>(extra, collected);
    let t = fma(v_color[2], color[2], fma(v_color[1], color[1], v_color[0] * color[0]));
    let tx = t * weights.dx;
    add(slot, &sums([v_color[0], v_color[1], v_color[2], tx, s_u, tx * weights.dx, s_u * weights.dx, s_uu]));
}

/// Computes the gradients by the colours alone, as [`backward`] does: [`COLOR_STRIDE`] numbers per
/// entry.
#[inline(always)]
pub(crate) fn backward_colors<S: Simd>(
    simd: S,
    entries: &[Entry],
    projected: &[Splat],
    first_column: usize,
    first_row: usize,
    rows: &[Row],
    slots: &Slots,
) {
    for entry in entries {
        let s = &projected[entry.splat as usize];
        let [row, end] = entry.rows.map(|row| usize::from(row) - first_row);
        let mut slot = [0.0; COLOR_STRIDE];
        each_part!(S; colors_part(simd, s, first_column, usize::from(entry.rows[0]), &rows[row..end], &mut slot));
        slots.put(entry.slot, &slot);
    }
}

/// [`backward_colors`] of one entry, in the lanes of one vector.
#[inline(always)]
fn colors_part<S: Simd, V: Floats<S>>(
    simd: S,
    s: &Splat,
    first_column: usize,
    mut row: usize,
    rows: &[Row],
    slot: &mut [f32; COLOR_STRIDE],
    lane: usize,
) {
    if passes_by::<S, V>(s, first_column, lane) {
        return;
    }
    let zero: V = splat(simd, 0.0);
    let mut weights = Weights::<V>::new(simd, s, first_column, lane);
    let mut v_color = [zero; 3];
    for rows in rows.chunks(s.restart_rows as usize) {
        weights.start(simd, u_in_row(simd, s, weights.dx, row));
        row += rows.len();
        for Row(v) in rows {
            let (w, _) = weights.above(simd, s);
            for k in 0..3 {
                v_color[k] = fma(w, load(simd, &v[k], lane), v_color[k]);
            }
            weights.advance::<S>();
        }
    }
    add(&mut slot[..3], &sums([v_color[0], v_color[1], v_color[2], zero, zero, zero, zero, zero]));
}
