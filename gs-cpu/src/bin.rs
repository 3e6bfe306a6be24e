//! Stage `bin`: lists the Gaussians that touch each tile, with the rows that they touch.
//!
//! Parallel over Gaussians, then over groups of tiles. Bounds are tight: an entry covers
//! the rows in which the ellipse of the α cut meets the tile's columns, so a Gaussian is not listed
//! in a tile where all its weights are below the cut. The entries of a tile are in the order of
//! ranks for every number of threads.

use std::{
    ops::Range,
    sync::atomic::{AtomicU32, Ordering::Relaxed},
};

use gs_core::{Error, memory};
use rayon::prelude::*;

use crate::{
    lanes::LANES,
    layout::Grid,
    level::{Level, dispatch},
    splat::{CHUNK, Splat},
    tile_inputs::GATHERED,
    unsupported::BACKEND,
};

/// One Gaussian in one tile.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Entry {
    /// Index into the projected splats.
    pub(crate) splat: u32,
    /// First image row, and the one after the last.
    pub(crate) rows: [u16; 2],
    /// Where its gradient is among those of all entries.
    pub(crate) slot: u32,
}

/// An entry that is not in its tile's list yet.
#[derive(Debug, Clone, Copy)]
struct Found {
    splat: u32,
    rows: [u16; 2],
    tile: u32,
}

/// The entries of one chunk of ranks.
#[derive(Debug, Default)]
struct Chunk {
    found: Vec<Found>,
    /// Number of entries per tile.
    counts: Vec<u32>,
    outside: u32,
}

/// The lists of entries of all tiles.
#[derive(Debug)]
pub(crate) struct Bins {
    /// Tile-major.
    pub(crate) entries: Vec<Entry>,
    /// First entry of each tile, `[tiles + 1]`.
    pub(crate) tile_start: Vec<u32>,
    /// First slot of each projected splat, and the end of the last: `[splats + 1]`. The slots of a splat
    /// are in the order of its tiles.
    slot_start: Vec<AtomicU32>,
    /// Splats that are not culled and touch no pixel.
    pub(crate) outside: u32,
    chunks: Vec<Chunk>,
    /// Per tile, the position of the next entry.
    cursors: Vec<u32>,
    /// Largest number of entries that is accepted. Tests lower it.
    pub(crate) most_entries: u32,
}

impl Default for Bins {
    fn default() -> Self {
        let (entries, tile_start, slot_start, chunks, cursors) = Default::default();
        // Positions are `u32`.
        Self { entries, tile_start, slot_start, outside: 0, chunks, cursors, most_entries: u32::MAX }
    }
}

/// Largest number of chunks: each has one count per tile.
const MOST_CHUNKS: usize = 64;

impl Bins {
    /// The slots of `projected[index]`.
    #[inline(always)]
    pub(crate) fn slots_of(&self, index: usize) -> Range<usize> {
        let [start, end] = [index, index + 1].map(|index| self.slot_start[index].load(Relaxed) as usize);
        start..end
    }

    /// The entries of a tile.
    pub(crate) fn of(&self, tile: usize) -> &[Entry] {
        &self.entries[self.tile_start[tile] as usize..self.tile_start[tile + 1] as usize]
    }

    /// Number of pixel–Gaussian pairs that the blend kernels visit: 16 per row of every entry.
    pub(crate) fn pairs(&self) -> u64 {
        self.entries.iter().map(|e| u64::from(e.rows[1] - e.rows[0]) * LANES as u64).sum()
    }

    /// Replaces the lists, and counts the Gaussians that touch no pixel.
    ///
    /// The splat at `rank` in 0..`count` is `projected[splat_at(rank)]`.
    ///
    /// # Errors
    /// [`Error::Backend`] for more entries than [`Self::most_entries`], and [`Error::Memory`]. The
    /// lists are invalid after an error.
    pub(crate) fn fill(
        &mut self,
        level: Level,
        projected: &[Splat],
        (count, splat_at): (usize, impl Fn(usize) -> usize + Sync),
        grid: &Grid,
    ) -> Result<(), Error> {
        let chunk_len = CHUNK.max(count.div_ceil(MOST_CHUNKS));
        self.chunks.resize_with(count.div_ceil(chunk_len), Chunk::default);
        self.slot_start.resize_with(projected.len() + 1, AtomicU32::default);
        self.slot_start.iter_mut().for_each(|count| *count.get_mut() = 0);
        let slots = &self.slot_start;
        self.chunks.par_iter_mut().enumerate().for_each(|(i, chunk)| {
            let ranks = i * chunk_len..((i + 1) * chunk_len).min(count);
            // For the level's own rounding instructions.
            dispatch!(level, _simd => chunk.find(projected, ranks, &splat_at, grid, slots));
        });
        self.outside = self.chunks.iter().map(|c| c.outside).sum::<u32>();

        let counts = |tile: usize| self.chunks.iter().map(move |chunk| chunk.counts[tile]);
        let total = count_entries((0..grid.tiles()).flat_map(counts), self.most_entries)?;
        self.tile_start.clear();
        self.tile_start.push(0);
        let mut next = 0;
        self.tile_start.extend((0..grid.tiles()).map(|tile| {
            next += counts(tile).sum::<u32>();
            next
        }));
        let mut next = 0;
        for start in &mut self.slot_start {
            next += std::mem::replace(start.get_mut(), next);
        }

        let what = "the list of all pairs of a Gaussian and a tile";
        memory::resize(&mut self.entries, total as usize, Entry::default(), what)?;
        self.cursors.clone_from(&self.tile_start);
        let Self { entries, tile_start, slot_start, chunks, cursors, .. } = self;
        let lists = (&mut entries[..], &mut cursors[..grid.tiles()]);
        scatter(0..grid.tiles(), tile_start, (chunks, slot_start), lists, rayon::current_num_threads());
        Ok(())
    }
}

/// The sum of `counts`, which must not be more than `most`.
fn count_entries(counts: impl Iterator<Item = u32>, most: u32) -> Result<u32, Error> {
    let asked: u64 = counts.map(u64::from).sum();
    u32::try_from(asked).ok().filter(|&asked| asked <= most).ok_or_else(|| Error::Backend {
        backend: BACKEND,
        message: format!(
            "{asked} pairs of a Gaussian and a tile that it touches, but at most {most} are possible; use fewer or smaller \
             Gaussians, or a smaller canvas"
        ),
    })
}

impl Chunk {
    #[inline(always)]
    fn find(
        &mut self,
        projected: &[Splat],
        ranks: Range<usize>,
        splat_at: &impl Fn(usize) -> usize,
        grid: &Grid,
        slots: &[AtomicU32],
    ) {
        self.found.clear();
        self.counts.clear();
        self.counts.resize(grid.tiles(), 0);
        self.outside = 0;
        // Copied a few at a time, as in `TileInputs::gather`.
        let mut splats = [(0, Splat::CULLED); GATHERED];
        for first in ranks.clone().step_by(GATHERED) {
            let splats = &mut splats[..(ranks.end - first).min(GATHERED)];
            for (rank, (index, splat)) in (first..).zip(&mut *splats) {
                *index = splat_at(rank);
                *splat = projected[*index];
            }
            for (index, splat) in splats {
                if !splat.is_culled() {
                    let before = self.found.len();
                    self.find_one(splat, *index as u32, grid);
                    let found = self.found.len() - before;
                    self.outside += u32::from(found == 0);
                    slots[*index].store(found as u32, Relaxed);
                }
            }
        }
    }

    #[inline(always)]
    fn find_one(&mut self, splat: &Splat, index: u32, grid: &Grid) {
        let bands = grid.bands();
        let Some((first_column, end_column)) = pixels(splat.mean[0], splat.half_x, splat.half_x, grid.width) else {
            return;
        };
        for strip in first_column / LANES..=(end_column - 1) / LANES {
            let left = (strip * LANES).max(first_column) as f32 + 0.5 - splat.mean[0];
            let right = ((strip + 1) * LANES).min(end_column) as f32 - 0.5 - splat.mean[0];
            let (top, bottom) = vertical_extent(splat, left, right);
            let Some((first_row, end_row)) = pixels(splat.mean[1], -top, bottom, grid.height) else {
                continue;
            };
            let (mut row, mut band) = (first_row, first_row / grid.band_rows);
            while row < end_row {
                let (tile, end) = (strip * bands + band, end_row.min((band + 1) * grid.band_rows));
                self.found.push(Found { splat: index, rows: [row, end].map(|r| r as u16), tile: tile as u32 });
                self.counts[tile] += 1;
                (row, band) = (end, band + 1);
            }
        }
    }
}

/// Added to both sides of a Gaussian, px, so that rounding does not lose a pixel. The kernels apply
/// the exact test.
pub(crate) const SLACK: f32 = 1e-3;

/// Whether the bounding box of the cut's ellipse, of height 2 `half_y`, contains a pixel's centre.
pub(crate) fn touches(splat: &Splat, half_y: f32, grid: &Grid) -> bool {
    pixels(splat.mean[0], splat.half_x, splat.half_x, grid.width).is_some()
        && pixels(splat.mean[1], half_y, half_y, grid.height).is_some()
}

/// The pixels whose centres lie in [mean − before, mean + after], as first and end; `None` if
/// empty.
#[inline(always)]
fn pixels(mean: f32, before: f32, after: f32, side: usize) -> Option<(usize, usize)> {
    let first = (mean - before - 0.5 - SLACK).ceil().clamp(0.0, side as f32);
    let end = ((mean + after - 0.5 + SLACK).floor() + 1.0).clamp(0.0, side as f32);
    (first < end).then_some((first as usize, end as usize))
}

/// Lowest and highest dy of the cut's ellipse over dx in [left, right], which it meets.
#[inline(always)]
fn vertical_extent(splat: &Splat, left: f32, right: f32) -> (f32, f32) {
    let offset_at = |dx: f32| ((splat.reach - dx * dx * splat.inverse_xx).max(0.0) / splat.c).sqrt();
    let bottom_dx = splat.lowest_dx.clamp(left, right);
    let top_dx = (-splat.lowest_dx).clamp(left, right);
    (splat.slope * top_dx - offset_at(top_dx), splat.slope * bottom_dx + offset_at(bottom_dx))
}

/// Writes the entries of `tiles` into their lists. Each of `tasks` tasks reads all chunks and keeps
/// the entries of its own tiles.
fn scatter(
    tiles: Range<usize>,
    tile_start: &[u32],
    found: (&[Chunk], &[AtomicU32]),
    (entries, cursors): (&mut [Entry], &mut [u32]),
    tasks: usize,
) {
    let base = tile_start[tiles.start] as usize;
    if tasks > 1 && tiles.len() > 1 {
        // Half of the entries go to each side.
        let half = (base + entries.len() / 2) as u32;
        let middle = tile_start[..tiles.end].partition_point(|&s| s < half).clamp(tiles.start + 1, tiles.end - 1);
        let (left, right) = entries.split_at_mut(tile_start[middle] as usize - base);
        let (of_left, of_right) = cursors.split_at_mut(middle - tiles.start);
        rayon::join(
            || scatter(tiles.start..middle, tile_start, found, (left, of_left), tasks / 2),
            || scatter(middle..tiles.end, tile_start, found, (right, of_right), tasks - tasks / 2),
        );
        return;
    }
    let (chunks, slot_start) = found;
    let (mut last, mut slot) = (u32::MAX, 0);
    for &Found { splat, rows, tile } in chunks.iter().flat_map(|chunk| &chunk.found) {
        slot = if splat == last { slot + 1 } else { slot_start[splat as usize].load(Relaxed) };
        last = splat;
        if let Some(cursor) = cursors.get_mut((tile as usize).wrapping_sub(tiles.start)) {
            entries[*cursor as usize - base] = Entry { splat, rows, slot };
            *cursor += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn too_many_entries_are_an_error_that_names_a_remedy() {
        let most = u32::MAX;
        assert_eq!(count_entries([].into_iter(), most).unwrap(), 0);
        assert_eq!(count_entries([most - 7, 3, 4].into_iter(), most).unwrap(), most);
        let one_too_many = count_entries([most - 7, 3, 5].into_iter(), most);
        // 16,385 Gaussians that each cover all tiles of the largest canvas.
        let far_too_many = count_entries((0..1024 * 256).map(|_| 16_385), most);
        for (result, asked) in [(one_too_many, "4294967296"), (far_too_many, "4295229440")] {
            let message = result.unwrap_err().to_string();
            for part in ["backend cpu", asked, "4294967295", "fewer or smaller Gaussians", "smaller canvas"] {
                assert!(message.contains(part), "{part}: {message}");
            }
        }
    }
}
