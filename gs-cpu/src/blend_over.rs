//! Stages `blend` and `blend_bwd` under `Over`: C = Σ T α c, front to back. One task per tile.
//! A vector is a row of pixels, as in `at_pixel`.
//!
//! Both passes go through the entries front to back. A full pixel stores its transmittance with a
//! negative sign, so that every later Gaussian fails the test against the minimum. Rows whose
//! pixels are all full are skipped. The backward pass keeps T and v_C·(the colour behind) for each
//! pixel, and never divides by less than 1 − α_max.
//!
//! The legend is in `at_pixel`.

use fearless_simd::{Simd, prelude::*};

use crate::{
    at_pixel::{Over, Weights, add, add_absolute, add_collected, add_error, passes_by, u_in_row},
    collect::Collect,
    lanes::{Floats, LANES, Whole, each_part, fma, load, load3, splat, splat3, store, sums},
    layout::{Row, ScalarRow},
    slots::Slots,
    splat::Splat,
    tile_inputs::{GATHERED, TileInputs},
};

/// Numbers per entry that [`backward`] writes: those of `Sum`, and S (the sum of t). Those of K
/// follow.
pub(crate) const STRIDE: usize = 9;

/// Number of entries that are blended between two checks for full rows.
const CHECK_EVERY: usize = 32;

const _: () = assert!(CHECK_EVERY == GATHERED, "a check comes before the last entry of those gathered");

/// The rows of a tile in which some pixel is not full, one bit each.
#[derive(Debug, Clone, Copy)]
struct OpenRows(u64);

impl OpenRows {
    fn all(rows: usize) -> Self {
        Self(u64::MAX >> (u64::BITS as usize - rows))
    }

    /// The range from the first to the last open row among rows `first` to `end`.
    #[inline(always)]
    fn within(self, [first, end]: [usize; 2]) -> Option<[usize; 2]> {
        let open = self.0 & (u64::MAX << first) & (u64::MAX >> (u64::BITS as usize - end));
        let [first, end] = [open.trailing_zeros(), u64::BITS - open.leading_zeros()].map(|row| row as usize);
        (open != 0).then_some([first, end])
    }

    /// Closes the rows whose pixels are all full, that is, whose transmittances are negative.
    #[inline(always)]
    fn close_full_rows<S: Simd>(&mut self, simd: S, rows: &[impl Transmittances]) {
        let mut left = self.0;
        while left != 0 {
            let row = left.trailing_zeros() as usize;
            left &= left - 1;
            let t: Whole<S> = load(simd, rows[row].transmittances(), 0);
            if t.simd_lt(splat::<S, Whole<S>>(simd, 0.0)).all_true() {
                self.0 &= !(1 << row);
            }
        }
    }
}

/// A row that stores its pixels' transmittances.
trait Transmittances {
    fn transmittances(&self) -> &[f32; LANES];
}

impl Transmittances for ScalarRow {
    #[inline(always)]
    fn transmittances(&self) -> &[f32; LANES] {
        &self.0
    }
}

/// A row during a backward pass.
impl Transmittances for Row {
    #[inline(always)]
    fn transmittances(&self) -> &[f32; LANES] {
        &self.0[0]
    }
}

/// The initial transmittances of a row: pixels beyond the image are full from the start.
fn unobstructed(lanes_inside: usize) -> [f32; LANES] {
    std::array::from_fn(|lane| if lane < lanes_inside { 1.0 } else { -1.0 })
}

/// Blends the entries' Gaussians and `background` into `rows`, and stores the final transmittances.
#[inline(always)]
pub(crate) fn forward<S: Simd>(
    simd: S,
    inputs: &TileInputs<'_>,
    rows: &mut [Row],
    transmittance: &mut [ScalarRow],
    background: [f32; 3],
) {
    rows.fill(Row::ZERO);
    transmittance.fill(ScalarRow(unobstructed(inputs.lanes_inside)));
    let mut open = OpenRows::all(rows.len());
    let mut splats = [Splat::CULLED; GATHERED];
    'entries: for entries in inputs.entries.chunks(GATHERED) {
        inputs.gather(entries, &mut splats);
        for (number, (entry, s)) in entries.iter().zip(&splats).enumerate() {
            if number == CHECK_EVERY - 1 {
                open.close_full_rows(simd, transmittance);
                if open.0 == 0 {
                    break 'entries;
                }
            }
            let Some([row, end]) = open.within(inputs.rows_of(entry)) else { continue };
            let (rows, transmittance) = (&mut rows[row..end], &mut transmittance[row..end]);
            each_part!(S; forward_part(simd, s, inputs, inputs.first_row + row, rows, transmittance));
        }
    }
    for (Row(pixels), ScalarRow(t)) in rows.iter_mut().zip(transmittance) {
        for lane in (0..LANES).step_by(S::f32s::LEN) {
            let left: S::f32s = load(simd, t, lane);
            let left = left.abs();
            store(left, t, lane);
            for k in 0..3 {
                let sum = fma(left, splat(simd, background[k]), load(simd, &pixels[k], lane));
                store(sum, &mut pixels[k], lane);
            }
        }
    }
}

/// [`forward`] of one entry, in the lanes of one vector.
#[inline(always)]
fn forward_part<S: Simd, V: Floats<S>>(
    simd: S,
    s: &Splat,
    &TileInputs { accuracy, first_column, .. }: &TileInputs<'_>,
    mut row: usize,
    rows: &mut [Row],
    transmittance: &mut [ScalarRow],
    lane: usize,
) {
    if passes_by::<S, V>(s, first_column, lane) {
        return;
    }
    let over = Over::<V>::new(simd, s, accuracy);
    let color = splat3(simd, s.color);
    let mut weights = Weights::<V>::new(simd, s, first_column, lane);
    let run = s.restart_rows as usize;
    for (rows, transmittance) in rows.chunks_mut(run).zip(transmittance.chunks_mut(run)) {
        weights.start(simd, u_in_row(simd, s, weights.dx, row));
        row += rows.len();
        for (Row(pixels), ScalarRow(t)) in rows.iter_mut().zip(transmittance) {
            let share = over.blended(simd, &weights, t, lane).share;
            for k in 0..3 {
                store(fma(share, color[k], load(simd, &pixels[k], lane)), &mut pixels[k], lane);
            }
            weights.advance::<S>();
        }
    }
}

/// Computes the entries' gradients from v_C = `v_rows` into `slots`.
///
/// A slot has [`STRIDE`] numbers, and those of K. `rows` holds the finished colours and is
/// overwritten. `errors` are the pixels' errors if K needs them.
#[inline(always)]
pub(crate) fn backward<S: Simd, K: Collect>(
    simd: S,
    inputs: &TileInputs<'_>,
    rows: &mut [Row],
    v_rows: &[Row],
    errors: &[ScalarRow],
    slots: &Slots,
) {
    let unobstructed = unobstructed(inputs.lanes_inside);
    for (Row(pixels), Row(v)) in rows.iter_mut().zip(v_rows) {
        // From here on, channel 0 is T and channel 1 is v_C·(the colour behind).
        for lane in (0..LANES).step_by(S::f32s::LEN) {
            let [r, g, b]: [S::f32s; 3] = load3(simd, pixels, lane);
            let [v_r, v_g, v_b]: [S::f32s; 3] = load3(simd, v, lane);
            store(load::<S, S::f32s>(simd, &unobstructed, lane), &mut pixels[0], lane);
            store(fma(b, v_b, fma(g, v_g, r * v_r)), &mut pixels[1], lane);
        }
    }
    let mut open = OpenRows::all(rows.len());
    let mut splats = [Splat::CULLED; GATHERED];
    for entries in inputs.entries.chunks(GATHERED) {
        if open.0 != 0 {
            inputs.gather(entries, &mut splats);
        }
        for (number, (entry, s)) in entries.iter().zip(&splats).enumerate() {
            if number == CHECK_EVERY - 1 {
                open.close_full_rows(simd, rows);
            }
            let mut slot = [0.0; STRIDE + 2];
            if let Some([row, end]) = open.within(inputs.rows_of(entry)) {
                let (rows, v_rows) = (&mut rows[row..end], &v_rows[row..end]);
                let errors = if K::ERROR { &errors[row..end] } else { &[] };
                let (row, slot) = (inputs.first_row + row, &mut slot[..]);
                each_part!(S, K; backward_part(simd, s, inputs, row, rows, v_rows, errors, slot));
            }
            slots.put(entry.slot, &slot[..STRIDE + K::NUMBERS]);
        }
    }
}

/// [`backward`] of one entry, in the lanes of one vector.
#[expect(clippy::too_many_arguments, reason = "a kernel's inputs are slices of different owners")]
#[inline(always)]
fn backward_part<S: Simd, V: Floats<S>, K: Collect>(
    simd: S,
    s: &Splat,
    &TileInputs { accuracy, first_column, .. }: &TileInputs<'_>,
    mut row: usize,
    rows: &mut [Row],
    v_rows: &[Row],
    mut errors: &[ScalarRow],
    slot: &mut [f32],
    lane: usize,
) {
    if passes_by::<S, V>(s, first_column, lane) {
        return;
    }
    let over = Over::<V>::new(simd, s, accuracy);
    let zero: V = splat(simd, 0.0);
    let color = splat3(simd, s.color);
    let mut weights = Weights::<V>::new(simd, s, first_column, lane);
    let (mut v_color, mut s_0, mut s_u, mut s_uu) = ([zero; 3], zero, zero, zero);
    let across = weights.dx * s.inverse_xx;
    let mut collected = [zero; 2];
    let run = s.restart_rows as usize;
    for (rows, v_rows) in rows.chunks_mut(run).zip(v_rows.chunks(run)) {
        let mut u = u_in_row(simd, s, weights.dx, row);
        weights.start(simd, u);
        row += rows.len();
        for (Row([t, rest, _]), Row(v)) in rows.iter_mut().zip(v_rows) {
            let blended = over.blended(simd, &weights, t, lane);
            let share = blended.share;
            let v = load3(simd, v, lane);
            for k in 0..3 {
                v_color[k] = fma(share, v[k], v_color[k]);
            }
            let v_dot_c = fma(v[2], color[2], fma(v[1], color[1], v[0] * color[0]));
            let rest_before: V = load(simd, rest, lane);
            let behind_it = rest_before - share * v_dot_c;
            store(behind_it, rest, lane);
            let t = over.through_alpha(&blended, v_dot_c, behind_it);
            let tu = t * u;
            s_0 += t;
            s_u += tu;
            s_uu = fma(tu, u, s_uu);
            if K::ABSOLUTE {
                add_absolute(&mut collected, t, across, u, s);
            }
            if K::ERROR {
                errors = add_error(simd, &mut collected, share, errors, lane);
            }
            if K::COUNT {
                collected[0] += blended.counted.select(splat(simd, 1.0), zero);
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
