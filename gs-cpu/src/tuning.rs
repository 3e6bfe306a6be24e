//! Settings of the kernels that change the time of a pass and its rounding, but not the picture.

use gs_core::Error;
use serde::{Deserialize, Serialize};

use crate::layout::MOST_ROWS_OVER;

/// The rows of a tile with which a Gaussian is listed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Bounds {
    /// The rows in which the ellipse of the cut meets the tile's columns.
    #[default]
    Tight,
    /// The rows of the ellipse's bounding box. An entry takes less time to compute, but the kernels
    /// visit more pixels below the cut. The image is the same except for rounding.
    Box,
}

/// Settings of the kernels of a [`CpuRasterizer`](crate::CpuRasterizer).
///
/// Four things are not settings. *The precision of exp*: the kernels call exp once in
/// [`Self::recurrence_rows`] rows, which determines its cost. *Compensated sums*: the rounding
/// error of a pixel was 4e-6 on the fit of a photograph (`docs/frontier/README.md`), a thousandth
/// of a display step. *Determinism*: each entry has a slot of its own, without locks or atomics.
/// *The width of a tile*: 16, the lanes of the widest vector.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub struct CpuTuning {
    /// Largest number of rows along which the recurrence computes a Gaussian's weights before exp
    /// is called again, 1 to 256. 1 means exp at each pixel. The error of the recurrence grows with
    /// the square of its length. Default 32.
    pub recurrence_rows: u16,
    /// The rows with which a Gaussian is listed.
    pub bounds: Bounds,
    /// Rows of a tile, 8 to 64; `None`: 64 under [`Blend::Over`](gs_core::Blend), 1,024 under
    /// [`Blend::Sum`](gs_core::Blend), so that a strip of most images is one tile.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tile_rows: Option<u16>,
}

gs_core::impl_with!(CpuTuning);

impl Default for CpuTuning {
    fn default() -> Self {
        Self { recurrence_rows: 32, bounds: Bounds::Tight, tile_rows: None }
    }
}

impl CpuTuning {
    /// Fails where a number is outside its range.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first offender.
    pub fn validate(&self) -> Result<(), Error> {
        Error::within("recurrence-rows", self.recurrence_rows, 1..=256, "1 to 256")?;
        let rows = self.tile_rows;
        rows.map_or(Ok(()), |rows| Error::within("tile-rows", rows, 8..=MOST_ROWS_OVER as u16, "8 to 64"))
    }
}
