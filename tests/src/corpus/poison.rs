//! Values that nobody would write down, in every slot of every input: they are refused, or drawn as the oracle draws them, or quarantined and
//! counted; and they change no pixel that the Gaussian does not touch, which holds one.

mod inputs;
mod state;

use std::{cell::OnceCell, fmt::Display, time::Instant};

use gs_core::{Chart, PlanarScene, Rasterizer, SpatialScene};

use self::state::Clean;
use super::report::{Observed, Record};
use crate::{conformance::charts, failure::Failure, subject::Subject};

pub use self::inputs::{Breadth, Inputs, Offered, Slot};

/// What is put into a slot: not numbers, infinities, the ends of `f32`, where exp and squares overflow, zeros, and what is flushed to zero.
pub const VALUES: [f32; 22] = [
    f32::NAN,
    -f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::MAX,
    f32::MIN,
    1e30,
    -1e30,
    1e19,
    -1e19,
    1e10,
    -1e10,
    88.8,
    -88.8,
    0.0,
    -0.0,
    1e-20,
    -1e-20,
    f32::MIN_POSITIVE,
    -f32::MIN_POSITIVE,
    1e-45,
    -1e-45,
];

/// Puts every value into every slot of planar inputs; a record for each slot.
pub fn poison_planar<R: Rasterizer<PlanarScene>>(rasterizer: &R) -> Vec<Record> {
    poison_planar_slots(rasterizer, |_| true)
}

/// [`poison_planar`], but for those slots alone of whose records' names `wanted` is true.
pub fn poison_planar_slots<R: Rasterizer<PlanarScene>>(
    rasterizer: &R,
    wanted: impl Fn(&str) -> bool + Copy,
) -> Vec<Record> {
    let views = inputs::canvas_slots();
    inputs::planar().iter().flat_map(|inputs| poison(rasterizer, inputs, &views, wanted)).collect()
}

/// Puts every value into every slot of spatial inputs; a record for each slot.
pub fn poison_spatial<R: Rasterizer<SpatialScene>>(rasterizer: &R) -> Vec<Record> {
    poison_spatial_slots(rasterizer, |_| true)
}

/// [`poison_spatial`], but for those slots alone of whose records' names `wanted` is true.
pub fn poison_spatial_slots<R: Rasterizer<SpatialScene>>(
    rasterizer: &R,
    wanted: impl Fn(&str) -> bool + Copy,
) -> Vec<Record> {
    let views = inputs::camera_slots();
    inputs::spatial().iter().flat_map(|inputs| poison(rasterizer, inputs, &views, wanted)).collect()
}

/// `views`: the slots of their views.
fn poison<S: Subject, R: Rasterizer<S>>(
    rasterizer: &R,
    inputs: &Inputs<S>,
    views: &[Slot<S>],
    wanted: impl Fn(&str) -> bool,
) -> Vec<Record> {
    let record = |slot: &dyn Display, outcome: &mut dyn FnMut() -> Result<usize, Failure>| {
        let case = format!("poison, {}: {slot}", inputs.name);
        wanted(&case).then(|| {
            let start = Instant::now();
            let outcome = outcome().map(|runs| Observed { runs, ..Observed::default() });
            Record { case, backend: rasterizer.describe(), outcome, took: start.elapsed() }
        })
    };
    let mut records = Vec::new();
    let charts = charts::<S, R>(rasterizer).unwrap_or_else(|failure| {
        records.extend(record(&"charts", &mut || Err(failure.clone())));
        Vec::new()
    });
    for chart in charts {
        // Shared by all slots, and made only where one of them is wanted.
        let clean = OnceCell::new();
        let clean = || clean.get_or_init(|| Clean::new(rasterizer, inputs, chart)).as_ref().map_err(Failure::clone);
        match state::slots(rasterizer, inputs, chart) {
            Ok(of_state) => {
                for slot in of_state {
                    let name = in_chart(&slot, chart);
                    records.extend(record(&name, &mut || state::poison(rasterizer, inputs, clean()?, &slot)));
                }
            }
            Err(failure) => records.extend(record(&in_chart(&"state", chart), &mut || Err(failure.clone()))),
        }
    }
    for slot in views.iter().chain(&inputs.slots()) {
        records.extend(record(&slot.name, &mut || inputs::poison(rasterizer, inputs, slot)));
    }
    records
}

/// The name of what is done in a chart.
fn in_chart(what: &dyn Display, chart: Chart) -> String {
    match chart {
        Chart::ScaleRotation => what.to_string(),
        Chart::LocalFrame => format!("{what}, in local frames"),
    }
}
