//! Values that nobody would write down, in every slot of every input: they are refused, or drawn as the oracle draws them, or quarantined and
//! counted; and they change no pixel that the Gaussian does not touch, which holds one.

mod inputs;
mod state;

use std::time::Instant;

use gs_core::{PlanarScene, Rasterizer, SpatialScene};

use self::state::Clean;
use super::report::{Observed, Record};
use crate::{failure::Failure, subject::Subject};

pub use self::inputs::{Infinite, Inputs, Slot};

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
    inputs::planar()
        .iter()
        .flat_map(|(name, inputs)| poison(rasterizer, name, inputs, &inputs::planar_slots(), wanted))
        .collect()
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
    inputs::spatial()
        .iter()
        .flat_map(|(name, inputs)| poison(rasterizer, name, inputs, &inputs::spatial_slots(), wanted))
        .collect()
}

fn poison<S: Subject, R: Rasterizer<S>>(
    rasterizer: &R,
    name: &str,
    inputs: &Inputs<S>,
    slots: &[Slot<S>],
    wanted: impl Fn(&str) -> bool,
) -> Vec<Record> {
    let record = |slot: &str, outcome: &mut dyn FnMut() -> Result<usize, Failure>| {
        let case = format!("poison, {name}: {slot}");
        wanted(&case).then(|| {
            let start = Instant::now();
            let outcome = outcome().map(|runs| Observed { runs, ..Observed::default() });
            Record { case, backend: rasterizer.describe(), outcome, took: start.elapsed() }
        })
    };
    let mut records = Vec::new();
    let clean = Clean::new(rasterizer, inputs);
    match clean.and_then(|clean| Ok((state::slots(&clean.state)?, clean))) {
        Ok((of_state, clean)) => {
            for slot in of_state {
                records.extend(record(&slot.to_string(), &mut || state::poison(rasterizer, inputs, &clean, &slot)));
            }
        }
        Err(failure) => records.extend(record("state", &mut || Err(failure.clone()))),
    }
    for slot in slots {
        records.extend(record(slot.name, &mut || inputs::poison(rasterizer, inputs, slot)));
    }
    records
}
