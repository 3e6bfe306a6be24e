//! What is reported of camera flights: a table, a chart, and a picture.

use std::fmt;

use gs_core::{Camera, Image, Optimizer, RenderSettings, Scene3d};
use gs_io::{LodFile3d, png_bytes};
use gs_train::Error;

use super::{
    comparison::{AtStep, Popping, PoppingComparison, SlowOrbit, compare},
    pictures::picture,
    ways::{Levels, Orders, Ways},
};
use crate::{
    price::Loaded,
    report::{
        Cell, Table,
        figure::{Axis, Figure, Marks, Series},
    },
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

/// Flies around a scene in both orders of blending and otherwise the settings `render`. `what` names the scene.
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
    prices(&mut Orders { on: Loaded::new(on, scene)?, render: *render }, flight, first, what)
}

/// Flies around a scene with levels of detail of which each frame draws as many Gaussians as it needs, at most `budget`,
/// and otherwise with the settings `render`, at 60 frames a second: with levels that change at once, and with
/// [transitions](gs_io::LevelsInMemory::shown_at). `what` names the scene.
///
/// # Errors
/// [`gs_core::Error::Setting`] where the flight or the budget is not possible; those of the backend, and of reading.
pub fn popping_prices_of_levels<R: Optimizer<Scene3d>>(
    on: &R,
    (file, budget): (&LodFile3d, usize),
    flight: &SlowOrbit,
    first: &Camera,
    render: &RenderSettings,
    what: &str,
) -> Result<PoppingPrices, Error> {
    prices(&mut Levels::new(on, file, budget, *render), flight, first, what)
}

fn prices(ways: &mut dyn Ways, flight: &SlowOrbit, first: &Camera, what: &str) -> Result<PoppingPrices, Error> {
    let (compared, names) = (compare(ways, flight, first)?, ways.names());
    let columns = columns(ways.what());
    Ok(PoppingPrices {
        table: Table::new("popping", format!("{what}: what jumps"), &columns, rows(&compared, names)),
        chart: trajectory_chart(what, &compared, names),
        picture: picture(&compared.moment)?,
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

/// The columns of [`rows`], if this distinguishes both ways.
fn columns(what: &str) -> [&str; 5] {
    ["step, °", what, "jumps, levels² per degree", "visible jumps per pixel and degree", "highest flicker, levels"]
}

/// The jumps with each step and way.
fn rows(comparison: &PoppingComparison, names: [&'static str; 2]) -> Vec<Vec<Cell>> {
    let of_step = |at: &AtStep| {
        let of_way = |(name, popping): (&'static str, &Popping)| -> Vec<Cell> {
            vec![
                Cell::Significant(at.step_degrees, 3),
                name.into(),
                Cell::Significant(popping.squares(), 3),
                Cell::Significant(popping.times(), 3),
                Cell::Significant(popping.highest, 3),
            ]
        };
        names.into_iter().zip(&at.ways).map(of_way).collect::<Vec<_>>()
    };
    comparison.steps.iter().flat_map(of_step).collect()
}

/// The flicker with the finest step, frame by frame.
fn trajectory_chart(what: &str, comparison: &PoppingComparison, names: [&str; 2]) -> Figure {
    let curve = |(name, popping): (&str, &Popping)| {
        let points = (1..).zip(&popping.trajectory).map(|(triple, &levels)| (f64::from(triple), levels));
        Series::line(name, points.collect())
    };
    Figure {
        name: "flicker".to_owned(),
        title: format!("{what}: flicker, frame by frame"),
        x: Axis::linear("frame, stretch after stretch"),
        y: Axis::linear("root mean square second difference, 8-bit levels"),
        marks: Marks::lines(names.into_iter().zip(&comparison.finest().ways).map(curve).collect()),
    }
}
