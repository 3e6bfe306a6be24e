//! Stages `blend` and `blend_bwd` under `Over` in the order of depth at each pixel: exact, whatever interpenetrates. One task per tile.
//!
//! Row by row, the weights and depths of all entries that reach the row are computed a vector at a time; each pixel gathers those above
//! the cut, sorts them, and blends them front to back. Tiles come in the order of mean depth, so what is to be sorted is nearly sorted.
//! The backward pass does the same again, and adds what every pixel finds to its entry's slot: one task, one order of sums.
//!
//! Legend: as in `blend_over`.

use fearless_simd::{Level, Simd, dispatch};
use gs_core::splat::over::{self, Backward, Forward};

use crate::{
    blend_over::STRIDE,
    collect::Collect,
    lanes::{LANES, Whole, exp, fma, iota, splat, store},
    layout::{Row, ScalarRow},
    tiles::Sight,
};

/// How a Gaussian's depth depends on the pixel.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct PixelDepth {
    /// z at the mean, world units.
    pub(crate) depth: f32,
    /// By px along x and y.
    pub(crate) slope: [f32; 2],
    /// Its index in the scene, which decides ties.
    pub(crate) index: u32,
}

/// An entry as a pixel sees it.
#[derive(Debug, Clone, Copy)]
struct Seen {
    /// Depth, then index.
    key: u64,
    /// Which of the tile's entries.
    entry: u32,
    /// o·w, above the cut.
    uncut: f32,
}

/// What a task works with.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    /// Where the entries of each row begin in `reaching`; one more for the end.
    row_start: Vec<u32>,
    /// Which entries reach a row, in their order.
    reaching: Vec<u32>,
    /// What each pixel of a row sees.
    seen: [Vec<Seen>; LANES],
}

/// The bits of a number such that greater numbers have greater bits.
fn ordered(value: f32) -> u32 {
    let bits = value.to_bits();
    if bits >> 31 == 0 { bits | 1 << 31 } else { !bits }
}

impl Scratch {
    /// Lists which entries reach each of `rows` rows.
    fn list_rows(&mut self, sight: &Sight<'_>, rows: usize) {
        self.row_start.clear();
        self.row_start.resize(rows + 2, 0);
        for entry in sight.entries {
            let [first, end] = sight.rows_of(entry);
            self.row_start[first + 2..end + 2].iter_mut().for_each(|count| *count += 1);
        }
        for row in 1..rows + 2 {
            self.row_start[row] += self.row_start[row - 1];
        }
        // From here on, `row_start[row + 1]` is where row `row`'s next one goes; in the end, where it ends.
        self.reaching.resize(self.row_start[rows + 1] as usize, 0);
        for (number, entry) in sight.entries.iter().enumerate() {
            let [first, end] = sight.rows_of(entry);
            for next in &mut self.row_start[first + 1..end + 1] {
                self.reaching[*next as usize] = number as u32;
                *next += 1;
            }
        }
    }

    /// What the pixels of row `row` of the tile see, nearest first.
    fn look(&mut self, level: Level, sight: &Sight<'_>, row: usize) {
        dispatch!(level, simd => self.look_at(simd, sight, row));
        for seen in &mut self.seen {
            seen.sort_unstable_by_key(|seen| seen.key);
        }
    }

    /// What the pixels of row `row` of the tile see, in the order of the lists.
    #[inline(always)]
    fn look_at<S: Simd>(&mut self, simd: S, sight: &Sight<'_>, row: usize) {
        self.seen.iter_mut().for_each(Vec::clear);
        let (mut uncut_lanes, mut depth_lanes) = ([0.0; LANES], [0.0; LANES]);
        for &number in &self.reaching[self.row_start[row] as usize..self.row_start[row + 1] as usize] {
            let place = sight.entries[number as usize].place as usize;
            let (s, at) = (&sight.projected[place], &sight.depths[place]);
            let dx = iota::<S, Whole<S>>(simd, 0) + (sight.first_column as f32 + 0.5 - s.mean[0]);
            let dy = (sight.first_row + row) as f32 + 0.5 - s.mean[1];
            let u = fma(dx, splat(simd, -s.slope), splat::<S, Whole<S>>(simd, dy));
            let across = dx * dx * (-0.5 * s.inverse_xx);
            let uncut = exp(simd, fma(u * u, splat(simd, -0.5 * s.c), across)) * s.opacity;
            let depth = fma(dx, splat(simd, at.slope[0]), splat::<S, Whole<S>>(simd, at.depth + at.slope[1] * dy));
            store(uncut, &mut uncut_lanes, 0);
            store(depth, &mut depth_lanes, 0);
            for lane in 0..LANES {
                if uncut_lanes[lane] >= s.cut {
                    let key = u64::from(ordered(depth_lanes[lane])) << 32 | u64::from(at.index);
                    self.seen[lane].push(Seen { key, entry: number, uncut: uncut_lanes[lane] });
                }
            }
        }
    }
}

/// Blends the entries' Gaussians into `rows`, before `background`, and says what transmittance is left.
pub(crate) fn forward(
    level: Level,
    sight: &Sight<'_>,
    scratch: &mut Scratch,
    rows: &mut [Row],
    transmittance: &mut [ScalarRow],
    background: [f32; 3],
) {
    scratch.list_rows(sight, rows.len());
    for (row, (Row(pixels), ScalarRow(left))) in rows.iter_mut().zip(transmittance).enumerate() {
        scratch.look(level, sight, row);
        for (lane, seen) in scratch.seen.iter().enumerate() {
            let mut pixel = Forward::default();
            for seen in seen {
                let s = &sight.projected[sight.entries[seen.entry as usize].place as usize];
                over::blend_fwd(&mut pixel, over::alpha(seen.uncut, sight.accuracy), s.color, sight.accuracy);
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

/// What the entries' Gaussians receive from v_C = `v_rows`: [`STRIDE`] numbers per entry and those that K asks for, into `slots`. `rows` holds
/// the finished colours; `errors` are those of the pixels, where K asks for them.
pub(crate) fn backward<K: Collect>(
    level: Level,
    sight: &Sight<'_>,
    scratch: &mut Scratch,
    rows: &[Row],
    v_rows: &[Row],
    errors: &[ScalarRow],
    slots: &mut [f32],
) {
    slots.fill(0.0);
    scratch.list_rows(sight, rows.len());
    for (row, (Row(pixels), Row(v))) in rows.iter().zip(v_rows).enumerate() {
        scratch.look(level, sight, row);
        for (lane, seen) in scratch.seen.iter().enumerate() {
            let at = |channels: &[[f32; LANES]; 3]| [channels[0][lane], channels[1][lane], channels[2][lane]];
            let mut pixel = Backward::new(at(v), at(pixels));
            for seen in seen {
                let s = &sight.projected[sight.entries[seen.entry as usize].place as usize];
                let alpha = over::alpha(seen.uncut, sight.accuracy);
                let before = pixel.transmittance;
                let Some((v_alpha, v_color)) = over::blend_bwd(&mut pixel, alpha, s.color, sight.accuracy) else {
                    break;
                };
                // The gradient of a clamped α is zero.
                let t = if seen.uncut <= sight.accuracy.alpha_max { v_alpha * alpha } else { 0.0 };
                let dx = (sight.first_column + lane) as f32 + 0.5 - s.mean[0];
                let u = (sight.first_row + row) as f32 + 0.5 - s.mean[1] - s.slope * dx;
                let slot = &mut slots[seen.entry as usize * (STRIDE + K::NUMBERS)..][..STRIDE + K::NUMBERS];
                let [r, g, b] = v_color;
                let nine = [r, g, b, t * dx, t * u, t * dx * dx, t * dx * u, t * u * u, t];
                slot.iter_mut().zip(nine).for_each(|(total, value)| *total += value);
                if K::ABSOLUTE {
                    let down = s.c * u;
                    slot[STRIDE] += t.abs() * (s.inverse_xx * dx - s.slope * down).abs();
                    slot[STRIDE + 1] += t.abs() * down.abs();
                }
                if K::ERROR {
                    slot[STRIDE] += before * alpha * errors[row].0[lane];
                }
            }
        }
    }
}
