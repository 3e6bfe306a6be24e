//! What is reported of camera flights: a table, a chart, and a picture.

use std::fmt;

use gs_core::{Camera, Image, Optimizer, RenderSettings, Scene3d, effects::Order};
use gs_io::png_bytes;
use gs_train::Error;

use super::{
    comparison::{AtStep, ORDERS, Popping, PoppingComparison, SlowOrbit, compare},
    pictures::picture,
};
use crate::report::{
    Cell, Table,
    figure::{Axis, Figure, Marks, Series},
};

/// How much jumps in a scene while the camera moves.
#[derive(Debug, Clone, PartialEq)]
pub struct PoppingPrices {
    table: Table,
    /// Flicker frame by frame.
    chart: Figure,
    /// The place where popping shows best.
    picture: Image,
}

/// Flies around a scene with both sort orders and otherwise the settings `render`. `what` names the scene.
///
/// # Errors
/// [`gs_core::Error::Setting`] where the flight is not possible; those of the backend, such as
/// [`gs_core::Error::Unsupported`] where it does not support both orders.
pub fn popping_prices<R: Optimizer<Scene3d>>(
    on: &R,
    scene: &Scene3d,
    flight: &SlowOrbit,
    first: &Camera,
    render: &RenderSettings,
    what: &str,
) -> Result<PoppingPrices, Error> {
    let compared = compare(on, scene, flight, first, render)?;
    Ok(PoppingPrices {
        table: Table::new("popping", format!("{what}: what jumps"), &STEP_COLUMNS, rows(&compared)),
        chart: trajectory_chart(what, &compared),
        picture: picture(on, scene, &compared, render)?,
    })
}

impl PoppingPrices {
    /// Names and contents of files: the table as CSV, the chart as SVG, and the picture as PNG.
    pub fn files(&self) -> Vec<(String, Vec<u8>)> {
        let files = [
            ("popping.csv", self.table.csv().into_bytes()),
            ("flicker-chart.svg", self.chart.svg_file().into_bytes()),
            ("popping.png", png_bytes(&self.picture)),
        ];
        files.map(|(name, bytes)| (name.to_owned(), bytes)).into()
    }
}

/// The table below its title.
impl fmt::Display for PoppingPrices {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}\n{}", self.table.title, self.table.text())
    }
}

/// The columns of [`rows`].
const STEP_COLUMNS: [&str; 5] =
    ["step, °", "order", "jumps, levels² per degree", "visible jumps per pixel and degree", "highest flicker, levels"];

/// The jumps with each step and order.
fn rows(comparison: &PoppingComparison) -> Vec<Vec<Cell>> {
    let of_step = |at: &AtStep| {
        let of_order = |(order, popping): (Order, &Popping)| -> Vec<Cell> {
            vec![
                Cell::Significant(at.step_degrees, 3),
                order.name().into(),
                Cell::Significant(popping.squares(), 3),
                Cell::Significant(popping.times(), 3),
                Cell::Significant(popping.highest, 3),
            ]
        };
        ORDERS.into_iter().zip(&at.orders).map(of_order).collect::<Vec<_>>()
    };
    comparison.steps.iter().flat_map(of_step).collect()
}

/// The flicker with the finest step, frame by frame.
fn trajectory_chart(what: &str, comparison: &PoppingComparison) -> Figure {
    let curve = |(order, popping): (Order, &Popping)| {
        let points = (1..).zip(&popping.trajectory).map(|(triple, &levels)| (f64::from(triple), levels));
        Series::line(order.name(), points.collect())
    };
    Figure {
        name: "flicker".to_owned(),
        title: format!("{what}: flicker, frame by frame"),
        x: Axis::linear("frame, stretch after stretch"),
        y: Axis::linear("root mean square second difference, 8-bit levels"),
        marks: Marks::lines(ORDERS.into_iter().zip(&comparison.finest().orders).map(curve).collect()),
    }
}
