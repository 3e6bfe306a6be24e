//! Stages `blend` and `blend_bwd` under `Over` with a sort at each pixel. One task per tile.
//!
//! The order is exact even where Gaussians interpenetrate. For each row, the weights and depths of
//! all entries that reach it are computed one vector at a time. Each pixel gathers those above the
//! cut, sorts them by depth and blends them front to back. The lists are in the order of mean
//! depth, so they are nearly sorted. The backward pass repeats this and adds each pixel's gradients
//! to the entries' slots: one task, one order of sums.
//!
//! One pixel's arithmetic is in [`over`]. Legend: that of `at_pixel`.

mod over;

use fearless_simd::Simd;

use self::over::{Backward, Forward};
use crate::{
    blend_over::STRIDE,
    collect::Collect,
    lanes::{LANES, Whole, exp, fma, iota, splat, store},
    layout::{Row, ScalarRow},
    level::{Level, dispatch},
    slots::Slots,
    tile_inputs::TileInputs,
};

/// An entry at one pixel.
#[derive(Debug, Clone, Copy)]
struct Seen {
    /// Depth, then index.
    key: u64,
    /// Index into the tile's entries.
    entry: u32,
    /// o·w, above the cut.
    uncut: f32,
}

/// The buffers of one task.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    /// Start of each row's entries in `reaching`, and the end.
    row_start: Vec<u32>,
    /// Entries that reach each row, in the order of the lists.
    reaching: Vec<u32>,
    /// Entries above the cut at each pixel of a row.
    seen: [Vec<Seen>; LANES],
    /// Gradients of the entries, `[entries, stride]`.
    gradients: Vec<f32>,
}

/// Maps a number to bits that compare as the numbers do.
fn ordered(value: f32) -> u32 {
    let bits = value.to_bits();
    if bits >> 31 == 0 { bits | 1 << 31 } else { !bits }
}

impl Scratch {
    /// Lists the entries that reach each of `rows` rows.
    fn list_rows(&mut self, inputs: &TileInputs<'_>, rows: usize) {
        self.row_start.clear();
        self.row_start.resize(rows + 2, 0);
        for entry in inputs.entries {
            let [first, end] = inputs.rows_of(entry);
            self.row_start[first + 2..end + 2].iter_mut().for_each(|count| *count += 1);
        }
        for row in 1..rows + 2 {
            self.row_start[row] += self.row_start[row - 1];
        }
        // `row_start[row + 1]` is the position of row `row`'s next entry, and in the end that of
        // its end.
        self.reaching.resize(self.row_start[rows + 1] as usize, 0);
        for (number, entry) in inputs.entries.iter().enumerate() {
            let [first, end] = inputs.rows_of(entry);
            for next in &mut self.row_start[first + 1..end + 1] {
                self.reaching[*next as usize] = number as u32;
                *next += 1;
            }
        }
    }

    /// Gathers the entries at each pixel of row `row` of the tile, nearest first.
    fn gather_sorted(&mut self, level: Level, inputs: &TileInputs<'_>, row: usize) {
        dispatch!(level, simd => self.gather(simd, inputs, row));
        for seen in &mut self.seen {
            seen.sort_unstable_by_key(|seen| seen.key);
        }
    }

    /// Gathers the entries at each pixel of row `row` of the tile, in the order of the lists.
    #[inline(always)]
    fn gather<S: Simd>(&mut self, simd: S, inputs: &TileInputs<'_>, row: usize) {
        self.seen.iter_mut().for_each(Vec::clear);
        let (mut uncut_lanes, mut depth_lanes) = ([0.0; LANES], [0.0; LANES]);
        for &number in &self.reaching[self.row_start[row] as usize..self.row_start[row + 1] as usize] {
            let index = inputs.entries[number as usize].splat;
            let (s, at) = (&inputs.projected[index as usize], &inputs.depths[index as usize]);
            let dx = iota::<S, Whole<S>>(simd, 0) + (inputs.first_column as f32 + 0.5 - s.mean[0]);
            let dy = (inputs.first_row + row) as f32 + 0.5 - s.mean[1];
            let u = fma(dx, splat(simd, -s.slope), splat::<S, Whole<S>>(simd, dy));
            let across = dx * dx * (-0.5 * s.inverse_xx);
            let uncut = exp(simd, fma(u * u, splat(simd, -0.5 * s.c), across)) * s.opacity;
            let depth = fma(dx, splat(simd, at.slope[0]), splat::<S, Whole<S>>(simd, at.depth + at.slope[1] * dy));
            store(uncut, &mut uncut_lanes, 0);
            store(depth, &mut depth_lanes, 0);
            for lane in 0..LANES {
                if uncut_lanes[lane] >= s.cut {
                    let key = u64::from(ordered(depth_lanes[lane])) << 32 | u64::from(index);
                    self.seen[lane].push(Seen { key, entry: number, uncut: uncut_lanes[lane] });
                }
            }
        }
    }
}

/// Blends the entries' Gaussians and `background` into `rows`, and stores the final transmittances.
pub(crate) fn forward(
    level: Level,
    inputs: &TileInputs<'_>,
    scratch: &mut Scratch,
    rows: &mut [Row],
    transmittance: &mut [ScalarRow],
    background: [f32; 3],
) {
    scratch.list_rows(inputs, rows.len());
    for (row, (Row(pixels), ScalarRow(left))) in rows.iter_mut().zip(transmittance).enumerate() {
        scratch.gather_sorted(level, inputs, row);
        for (lane, seen) in scratch.seen.iter().enumerate() {
            let mut pixel = Forward::default();
            for seen in seen {
                let s = &inputs.projected[inputs.entries[seen.entry as usize].splat as usize];
                over::blend_fwd(&mut pixel, over::alpha(seen.uncut, inputs.accuracy), s.color, inputs.accuracy);
                if pixel.full {
                    break;
                }
            }
            left[lane] = pixel.transmittance;
            for k in 0..3 {
                pixels[k][lane] = pixel.color[k] + pixel.transmittance * background[k];
            }
        }
    }
}

/// Computes the entries' gradients from v_C = `v_rows` into `slots`.
///
/// A slot has [`STRIDE`] numbers, and those of K. `rows` holds the finished colours. `errors` are
/// the pixels' errors if K needs them.
pub(crate) fn backward<K: Collect>(
    level: Level,
    inputs: &TileInputs<'_>,
    scratch: &mut Scratch,
    rows: &[Row],
    v_rows: &[Row],
    errors: &[ScalarRow],
    slots: &Slots,
) {
    let stride = STRIDE + K::NUMBERS;
    let mut gradients = std::mem::take(&mut scratch.gradients);
    gradients.clear();
    gradients.resize(inputs.entries.len() * stride, 0.0);
    scratch.list_rows(inputs, rows.len());
    for (row, (Row(pixels), Row(v))) in rows.iter().zip(v_rows).enumerate() {
        scratch.gather_sorted(level, inputs, row);
        for (lane, seen) in scratch.seen.iter().enumerate() {
            let at = |channels: &[[f32; LANES]; 3]| [channels[0][lane], channels[1][lane], channels[2][lane]];
            let mut pixel = Backward::new(at(v), at(pixels));
            for seen in seen {
                let s = &inputs.projected[inputs.entries[seen.entry as usize].splat as usize];
                let alpha = over::alpha(seen.uncut, inputs.accuracy);
                let before = pixel.transmittance;
                let Some((v_alpha, v_color)) = over::blend_bwd(&mut pixel, alpha, s.color, inputs.accuracy) else {
                    break;
                };
                // The gradient of a clamped α is zero.
                let t = if seen.uncut <= inputs.accuracy.alpha_max { v_alpha * alpha } else { 0.0 };
                let dx = (inputs.first_column + lane) as f32 + 0.5 - s.mean[0];
                let u = (inputs.first_row + row) as f32 + 0.5 - s.mean[1] - s.slope * dx;
                let slot = &mut gradients[seen.entry as usize * stride..][..stride];
                let [r, g, b] = v_color;
                let nine = [r, g, b, t * dx, t * u, t * dx * dx, t * dx * u, t * u * u, t];
                slot.iter_mut().zip(nine).for_each(|(total, value)| *total += value);
                if K::ABSOLUTE {
                    let down = s.c * u;
                    slot[STRIDE] += t.abs() * (s.inverse_xx * dx - s.slope * down).abs();
                    slot[STRIDE + 1] += t.abs() * down.abs();
                }
                if K::COUNT && lane < inputs.lanes_inside {
                    slot[STRIDE] += 1.0;
                }
                if K::ERROR {
                    slot[STRIDE] += before * alpha * errors[row].0[lane];
                }
            }
        }
    }
    for (entry, gradient) in inputs.entries.iter().zip(gradients.chunks_exact(stride)) {
        slots.put(entry.slot, gradient);
    }
    scratch.gradients = gradients;
}
