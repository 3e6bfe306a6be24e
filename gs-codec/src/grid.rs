//! The cells of a canvas, in which means are stored.

use crate::layer::LayerHead;

/// Square cells over a canvas and a margin around it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Grid {
    /// Cells from left to right.
    pub(crate) columns: u32,
    /// Cells from top to bottom.
    pub(crate) rows: u32,
    /// Side of a cell, px.
    cell: u32,
    /// Cells outside the canvas on each side.
    margin: u32,
}

impl Grid {
    pub(crate) fn new(head: &LayerHead, (width, height): (u32, u32)) -> Self {
        let (cell, margin) = (u32::from(head.cell.max(1)), u32::from(head.margin));
        let cells = |side: u32| side.div_ceil(cell) + 2 * margin;
        Self { columns: cells(width), rows: cells(height), cell, margin }
    }

    /// Number of cells.
    pub(crate) fn cells(&self) -> u64 {
        u64::from(self.columns) * u64::from(self.rows)
    }

    /// Whether a cell is in the margin.
    pub(crate) fn is_outside(&self, column: u32, row: u32) -> bool {
        let inside = |cell: u32, cells: u32| (self.margin..cells - self.margin).contains(&cell);
        !(inside(column, self.columns) && inside(row, self.rows))
    }

    /// x or y of a (column or row, place) where a cell has this many places, px.
    pub(crate) fn at(&self, (cell, place): (u32, u32), places: u32) -> f64 {
        let within = (f64::from(place) + 0.5) / f64::from(places);
        (f64::from(cell) - f64::from(self.margin) + within) * f64::from(self.cell)
    }

    /// The nearest (column or row, place) of an x or y, px, of this many columns or rows.
    pub(crate) fn rounded(&self, value: f64, places: u32, cells: u32) -> (u32, u32) {
        let all = f64::from(cells) * f64::from(places) - 1.0;
        let place = (value / f64::from(self.cell) + f64::from(self.margin)) * f64::from(places);
        let place = place.floor().clamp(0.0, all) as u64;
        ((place / u64::from(places)) as u32, (place % u64::from(places)) as u32)
    }
}
