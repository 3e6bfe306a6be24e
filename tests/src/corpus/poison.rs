//! Hostile values in every slot of every input. They must be refused, drawn as by the oracle, or
//! culled and counted, and must not change a pixel that the Gaussian does not touch.

mod inputs;
mod state;

use std::{cell::OnceCell, fmt::Display, time::Instant};

use gs_core::{Optimizer, Parameterization, Scene2d, Scene3d};

use self::state::Clean;
use super::report::{Observed, Record};
use crate::{conformance::parameterizations, failure::Failure, subject::Subject};

pub use self::inputs::{Breadth, Inputs, Offered, Slot};

/// The values: NaN, infinities, the ends of `f32`, where exp and squares overflow, zeros, and
/// subnormals.
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

/// Tests every value in every slot of 2D inputs. Returns a record for each slot.
pub fn poison_2d<R: Optimizer<Scene2d>>(rasterizer: &R) -> Vec<Record> {
    poison_slots_2d(rasterizer, |_| true)
}

/// [`poison_2d`] for the slots with a record name for which `wanted` is true.
pub fn poison_slots_2d<R: Optimizer<Scene2d>>(rasterizer: &R, wanted: impl Fn(&str) -> bool + Copy) -> Vec<Record> {
    let views = inputs::canvas_slots();
    inputs::scene_2d().iter().flat_map(|inputs| poison(rasterizer, inputs, &views, wanted)).collect()
}

/// Tests every value in every slot of 3D inputs. Returns a record for each slot.
pub fn poison_3d<R: Optimizer<Scene3d>>(rasterizer: &R) -> Vec<Record> {
    poison_slots_3d(rasterizer, |_| true)
}

/// [`poison_3d`] for the slots with a record name for which `wanted` is true.
pub fn poison_slots_3d<R: Optimizer<Scene3d>>(rasterizer: &R, wanted: impl Fn(&str) -> bool + Copy) -> Vec<Record> {
    let views = inputs::camera_slots();
    inputs::scene_3d().iter().flat_map(|inputs| poison(rasterizer, inputs, &views, wanted)).collect()
}

/// `views`: the slots of their views.
fn poison<S: Subject, R: Optimizer<S>>(
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
    let parameterizations = parameterizations::<S, R>(rasterizer).unwrap_or_else(|failure| {
        records.extend(record(&"parameterizations", &mut || Err(failure.clone())));
        Vec::new()
    });
    for parameterization in parameterizations {
        // Shared by all slots, and only made if one is wanted.
        let clean = OnceCell::new();
        let clean =
            || clean.get_or_init(|| Clean::new(rasterizer, inputs, parameterization)).as_ref().map_err(Failure::clone);
        match state::slots(rasterizer, inputs, parameterization) {
            Ok(of_state) => {
                for slot in of_state {
                    let name = in_parameterization(&slot, parameterization);
                    records.extend(record(&name, &mut || state::poison(rasterizer, inputs, clean()?, &slot)));
                }
            }
            Err(failure) => {
                records.extend(record(&in_parameterization(&"state", parameterization), &mut || Err(failure.clone())))
            }
        }
    }
    for slot in views.iter().chain(&inputs.slots()) {
        records.extend(record(&slot.name, &mut || inputs::poison(rasterizer, inputs, slot)));
    }
    records
}

/// The name of a test in a parameterization.
fn in_parameterization(what: &dyn Display, parameterization: Parameterization) -> String {
    match parameterization {
        Parameterization::ScaleRotation => what.to_string(),
        Parameterization::CovarianceFactor => format!("{what}, in covariance factors"),
    }
}
