//! What a blend kernel reads of one tile.

use gs_core::Accuracy;

use crate::{
    bin::Entry,
    splat::{PixelDepth, Splat},
};

/// List and position of a tile.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TileInputs<'a> {
    pub(crate) entries: &'a [Entry],
    pub(crate) projected: &'a [Splat],
    /// Depths of `projected`; only in 3D scenes.
    pub(crate) depths: &'a [PixelDepth],
    pub(crate) accuracy: &'a Accuracy,
    pub(crate) first_column: usize,
    pub(crate) first_row: usize,
    /// Number of lanes that are columns of the image.
    pub(crate) lanes_inside: usize,
}

/// Number of entries whose splats [`TileInputs::gather`] copies at once.
pub(crate) const GATHERED: usize = 32;

impl TileInputs<'_> {
    /// Copies the splats of at most [`GATHERED`] entries next to each other.
    ///
    /// Neighbours in a tile's list are far apart in memory. The copies are independent, so the
    /// processor waits for many of them at a time; a kernel's work on one splat is too long for it
    /// to look ahead to the next.
    #[inline(always)]
    pub(crate) fn gather(&self, entries: &[Entry], splats: &mut [Splat; GATHERED]) {
        for (splat, entry) in splats.iter_mut().zip(entries) {
            *splat = self.projected[entry.splat as usize];
        }
    }

    /// The rows of the tile that an entry touches, first and end.
    #[inline(always)]
    pub(crate) fn rows_of(&self, entry: &Entry) -> [usize; 2] {
        entry.rows.map(|row| usize::from(row) - self.first_row)
    }
}
