//! What is reported of camera flights: a table, a chart, and a picture.

use gs_core::{Camera, Optimizer, RenderSettings, Scene3d, effects::Order};
use gs_train::Error;

use super::{
    comparison::{AtStep, ORDERS, Popping, PoppingComparison, SlowOrbit, compare},
    pictures::picture,
};
use crate::report::{
    Cell, Findings, Table,
    figure::{Axis, Figure, Marks, Series},
};

/// Flies around a scene with both sort orders and otherwise the settings `render`. The result is a
/// table, a chart, and a picture of the place where popping shows best. `what` names the scene.
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
) -> Result<Findings, Error> {
    let compared = compare(on, scene, flight, first, render)?;
    Ok(Findings {
        charts: vec![trajectory_chart(what, &compared)],
        tables: vec![Table::new("popping", format!("{what}: what jumps"), &STEP_COLUMNS, rows(&compared))],
        pictures: vec![picture(on, scene, &compared, render, ("popping", what))?],
        ..Findings::default()
    })
}

/// The columns of [`rows`].
pub(crate) const STEP_COLUMNS: [&str; 5] =
    ["step, °", "order", "jumps, levels² per degree", "visible jumps per pixel and degree", "highest flicker, levels"];

/// The jumps with each step and order.
pub(crate) fn rows(comparison: &PoppingComparison) -> Vec<Vec<Cell>> {
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
pub(crate) fn trajectory_chart(what: &str, comparison: &PoppingComparison) -> Figure {
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
