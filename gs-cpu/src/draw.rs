//! An image without a backward pass: drawn a few strips at a time, so that it is in memory once.

use gs_core::{Error, Image};
use rayon::prelude::*;

use crate::{
    lanes::LANES,
    layout::{Grid, Row},
    level::Level,
    tiles::Tiles,
};

/// Size of the strips that are drawn before they are copied into the image.
///
/// It is enough to occupy every thread, and small compared with a large image.
const MOST_BYTES: usize = 32 << 20;

/// Number of strips that are drawn at once.
pub(crate) fn strips_at_once(grid: &Grid) -> usize {
    (MOST_BYTES / (grid.height * size_of::<Row>())).clamp(1, grid.strips())
}

impl Tiles {
    /// Runs stage `blend` into an image.
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub(crate) fn draw(&mut self, level: Level) -> Result<Image, Error> {
        let (grid, at_once) = (self.grid, strips_at_once(&self.grid));
        let (width, height) = grid.size();
        let mut image = Image::filled(width, height, [0.0; 3])?;
        for first in (0..grid.strips()).step_by(at_once) {
            let end = (first + at_once).min(grid.strips());
            self.blend_tiles(level, first * grid.bands()..end * grid.bands())?;
            let columns = first * LANES..(end * LANES).min(grid.width);
            let lines = image.pixels_mut().par_chunks_exact_mut(grid.width).enumerate();
            lines.for_each(|(y, line)| grid.put_line(&self.rows, y, &mut line[columns.clone()]));
        }
        Ok(image)
    }
}
