//! How the kernels go about their work where that is a choice: none of it changes what picture is meant, only the time that it takes, and
//! its roundings.

use gs_core::Error;
use serde::{Deserialize, Serialize};

use crate::layout::MOST_ROWS_OVER;

/// Which rows of a tile a Gaussian is listed with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Bounds {
    /// Those in which the ellipse of the cut meets the tile's columns.
    #[default]
    Tight,
    /// Those of the box around the ellipse: less to compute for each entry, and more pixels visited in vain. The image is the same but for
    /// rounding.
    Box,
}

/// How a [`CpuRasterizer`](crate::CpuRasterizer) goes about its work.
///
/// What is left out, and why. *The precision of exp*: the recurrence calls it once in [`Self::recurrence_rows`] rows, so that the length of
/// the recurrence is what its price hangs on. *Compensated sums*: all roundings of a pixel together came to 4e-6, a thousandth of a display step, on the
/// fit of a photograph (`docs/frontier/README.md`), so there is nothing that they would show. *Determinism*: each entry has a slot of its own, which takes
/// neither locks nor atomics; no other way was written or measured. *The width of a tile*: it is the sixteen lanes of the widest vector.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct CpuTuning {
    /// Most rows that a Gaussian's weights are computed along by two multiplications a row, before exp is called again, 1 to 256. 1 is exp at each pixel; the
    /// error of the recurrence grows with the square of the length. Default 32.
    pub recurrence_rows: u16,
    /// Which rows a Gaussian is listed with.
    pub bounds: Bounds,
    /// Rows of a tile, 8 to 64; none: 64 under [`Blend::Over`](gs_core::Blend), 1,024 under [`Blend::Sum`](gs_core::Blend), where most images are
    /// of one tile from top to bottom.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tile_rows: Option<u16>,
}

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
        if !(1..=256).contains(&self.recurrence_rows) {
            return Err(Error::setting("recurrence-rows", self.recurrence_rows, "1 to 256"));
        }
        match self.tile_rows {
            Some(rows) if !(8..=MOST_ROWS_OVER as u16).contains(&rows) => {
                Err(Error::setting("tile-rows", rows, "8 to 64"))
            }
            _ => Ok(()),
        }
    }
}
