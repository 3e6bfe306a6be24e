//! The layout of an image in memory: strips of 16 columns, cut into tiles.
//!
//! A row of a strip is one vector per channel. A tile is a band of a strip's rows. Buffers are
//! strip-major: all rows of strip s, top to bottom, then those of strip s + 1. A tile's rows are
//! therefore one slice.

use std::ops::Range;

use gs_core::{Error, Image, memory};

use crate::lanes::LANES;

/// Largest number of rows of a tile under `Over`, whose open rows are the bits of a `u64`.
pub(crate) const MOST_ROWS_OVER: usize = 64;

/// One row of a strip: 16 reds, 16 greens, 16 blues. Aligned to a cache line, which unaligned
/// 64-byte loads would straddle.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct Row(pub(crate) [[f32; LANES]; 3]);

/// One number per pixel of a strip's row.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct ScalarRow(pub(crate) [f32; LANES]);

impl Row {
    pub(crate) const ZERO: Self = Self([[0.0; LANES]; 3]);
}

/// An image's size and its division into strips and bands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Grid {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Rows of a tile. The last tile of a strip may have fewer.
    pub(crate) band_rows: usize,
}

impl Grid {
    pub(crate) fn new((width, height): (u32, u32), band_rows: usize) -> Self {
        Self { width: width as usize, height: height as usize, band_rows }
    }

    /// Columns and rows.
    pub(crate) fn size(&self) -> (u32, u32) {
        (self.width as u32, self.height as u32)
    }

    pub(crate) fn strips(&self) -> usize {
        self.width.div_ceil(LANES)
    }

    pub(crate) fn bands(&self) -> usize {
        self.height.div_ceil(self.band_rows)
    }

    pub(crate) fn tiles(&self) -> usize {
        self.strips() * self.bands()
    }

    /// Number of rows in a strip-major buffer.
    pub(crate) fn rows(&self) -> usize {
        self.strips() * self.height
    }

    /// First row of tile `tile` in a strip-major buffer; the buffer's end for `tile == tiles()`.
    pub(crate) fn first_row(&self, tile: usize) -> usize {
        let (strip, band) = (tile / self.bands(), tile % self.bands());
        strip * self.height + band * self.band_rows
    }

    /// The image column of a tile's first lane, and the image rows that the tile covers.
    pub(crate) fn place(&self, tile: usize) -> (usize, Range<usize>) {
        let (strip, band) = (tile / self.bands(), tile % self.bands());
        let first = band * self.band_rows;
        (strip * LANES, first..(first + self.band_rows).min(self.height))
    }

    /// Number of a tile's lanes that are columns of the image.
    pub(crate) fn lanes_inside(&self, tile: usize) -> usize {
        (self.width - (tile / self.bands()) * LANES).min(LANES)
    }

    /// An image's pixels as strips; lanes beyond the last column are 0.
    pub(crate) fn strips_of(&self, image: &Image) -> Result<Vec<Row>, Error> {
        let mut rows = Vec::new();
        self.put_strips(image, &mut rows, "a target")?;
        Ok(rows)
    }

    /// [`Self::strips_of`] into a buffer that is named `what` where memory runs out.
    pub(crate) fn put_strips(&self, image: &Image, rows: &mut Vec<Row>, what: &'static str) -> Result<(), Error> {
        memory::resize(rows, self.rows(), Row::ZERO, what)?;
        let last = rows.len() - self.height;
        rows[last..].fill(Row::ZERO);
        for (y, line) in image.pixels().chunks_exact(self.width).enumerate() {
            for (x, pixel) in line.iter().enumerate() {
                let row = &mut rows[(x / LANES) * self.height + y];
                for k in 0..3 {
                    row.0[k][x % LANES] = pixel[k];
                }
            }
        }
        Ok(())
    }

    /// Strips as an image.
    pub(crate) fn image_of(&self, rows: &[Row]) -> Result<Image, Error> {
        let mut image = Image::filled(self.width as u32, self.height as u32, [0.0; 3])?;
        for (y, line) in image.pixels_mut().chunks_exact_mut(self.width).enumerate() {
            self.put_line(rows, y, line);
        }
        Ok(image)
    }

    /// Copies image row `y` out of strips. `line` may be a part of the row that begins with the
    /// first strip of `rows`.
    pub(crate) fn put_line(&self, rows: &[Row], y: usize, line: &mut [[f32; 3]]) {
        for (x, pixel) in line.iter_mut().enumerate() {
            let row = &rows[(x / LANES) * self.height + y].0;
            *pixel = [0, 1, 2].map(|k| row[k][x % LANES]);
        }
    }
}

/// The buffers that tiles write to, each cut at tile borders. Unused buffers are empty.
#[derive(Debug)]
pub(crate) struct TileBuffers<'a> {
    pub(crate) rows: &'a mut [Row],
    /// A number per pixel: transmittance, or errors.
    pub(crate) scalars: &'a mut [ScalarRow],
    /// A partial sum per tile.
    pub(crate) sums: &'a mut [f64],
}

/// Runs `work(tile, its buffers)` for every tile of `tiles`, in parallel, without allocating.
pub(crate) fn for_each_tile<F>(tiles: Range<usize>, buffers: TileBuffers<'_>, grid: &Grid, work: &F)
where
    F: Fn(usize, TileBuffers<'_>) + Sync,
{
    match tiles.len() {
        0 => {}
        1 => work(tiles.start, buffers),
        n => {
            let middle = tiles.start + n / 2;
            let rows = grid.first_row(middle) - grid.first_row(tiles.start);
            let (rows_l, rows_r) = cut(buffers.rows, rows);
            let (scalars_l, scalars_r) = cut(buffers.scalars, rows);
            let (sums_l, sums_r) = cut(buffers.sums, n / 2);
            let left = TileBuffers { rows: rows_l, scalars: scalars_l, sums: sums_l };
            let right = TileBuffers { rows: rows_r, scalars: scalars_r, sums: sums_r };
            rayon::join(
                || for_each_tile(tiles.start..middle, left, grid, work),
                || for_each_tile(middle..tiles.end, right, grid, work),
            );
        }
    }
}

fn cut<T>(buffer: &mut [T], at: usize) -> (&mut [T], &mut [T]) {
    let at = if buffer.is_empty() { 0 } else { at };
    buffer.split_at_mut(at)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_and_back() {
        for size in [(1, 1), (16, 3), (17, 5), (40, 9)] {
            let image = Image::from_fn(size.0, size.1, |x, y| [x as f32, y as f32, 0.5]).unwrap();
            let grid = Grid::new(size, 4);
            assert_eq!(grid.image_of(&grid.strips_of(&image).unwrap()).unwrap(), image);
        }
    }

    #[test]
    fn tiles_cover_every_row_once() {
        let grid = Grid::new((40, 9), 4);
        let mut rows = vec![Row::ZERO; grid.rows()];
        let mut sums = vec![0.0; grid.tiles()];
        let buffers = TileBuffers { rows: &mut rows, scalars: &mut [], sums: &mut sums };
        for_each_tile(0..grid.tiles(), buffers, &grid, &|tile, buffers| {
            assert_eq!(buffers.rows.len(), grid.place(tile).1.len());
            buffers.rows.iter_mut().for_each(|row| row.0[0][0] += 1.0);
            buffers.sums[0] = tile as f64;
        });
        assert!(rows.iter().all(|row| row.0[0][0] == 1.0));
        assert!(sums.iter().enumerate().all(|(tile, &s)| s == tile as f64));
    }
}
