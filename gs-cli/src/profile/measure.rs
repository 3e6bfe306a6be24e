//! Measures a subject on a backend: the stages, as the backend sees them, and whole passes, as a caller sees them.

use std::time::Instant;

use gs_core::{
    Binning, Canvas, Error, PlanarScene, Rasterizer, Scene, TrainStep,
    profile::{Profiler, still},
};

use crate::{
    backend::{Backend, Task},
    failure::Failure,
    profile::{
        report::{Facts, Report},
        subject::Subject,
    },
};

/// Profiling as a task for any backend.
pub(crate) struct Measure<'a> {
    pub(crate) subject: Subject,
    pub(crate) backend: &'a Backend,
    pub(crate) repetitions: usize,
}

/// Seconds of whole passes, one each per repetition.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Whole {
    /// Training steps that make their lists anew.
    pub(crate) train_step_fresh: Vec<f64>,
    /// Training steps with the lists of the step before.
    pub(crate) train_step_reused: Vec<f64>,
    /// Forward passes alone.
    pub(crate) forward: Vec<f64>,
}

impl Task for Measure<'_> {
    type Output = Result<Report, Failure>;

    fn run<R: Profiler<PlanarScene>>(self, rasterizer: &R) -> Result<Report, Failure> {
        let Self { mut subject, backend, repetitions } = self;
        let ready = subject.prepare(rasterizer)?;
        let Subject { canvas, render, loss, chart, .. } = subject;
        let mut cloud = rasterizer.upload(&ready.scene, chart)?;
        let target = rasterizer.upload_target(&ready.target)?;
        let profile = rasterizer.profile(&mut cloud, &canvas, &target, &render, loss, repetitions)?;
        let rates = still();
        let step = TrainStep { settings: &render, loss, rates: &rates, binning: Binning::Fresh };
        let whole = whole(rasterizer, &mut cloud, (&canvas, &target), &step, repetitions)?;
        let facts = Facts {
            input: subject.file,
            name: subject.name,
            gaussians: ready.scene.len(),
            fitted_steps: ready.fitted_steps,
            target: ready.target_name,
            canvas,
            blend: render.effects.blend,
            loss,
            chart,
            repetitions,
        };
        Ok(Report::new(facts, backend, &profile, &whole))
    }
}

/// Runs whole passes, interleaved, after one of each without looking at the clock. The rates of `step` should be such that the
/// Gaussians stay where they are.
fn whole<R: Rasterizer<PlanarScene>>(
    rasterizer: &R,
    cloud: &mut R::Cloud,
    (canvas, target): (&Canvas, &R::Target),
    step: &TrainStep<'_>,
    repetitions: usize,
) -> Result<Whole, Error> {
    let mut whole = Whole::default();
    for repetition in 0..=repetitions {
        // Lists must be made before they can be used again.
        let laps = [
            lap(|| rasterizer.train_step(cloud, canvas, target, &TrainStep { binning: Binning::Fresh, ..*step }))?,
            lap(|| rasterizer.train_step(cloud, canvas, target, &TrainStep { binning: Binning::Reuse, ..*step }))?,
            lap(|| rasterizer.forward(cloud, canvas, step.settings))?,
        ];
        if repetition > 0 {
            whole.train_step_fresh.push(laps[0]);
            whole.train_step_reused.push(laps[1]);
            whole.forward.push(laps[2]);
        }
    }
    Ok(whole)
}

/// Seconds that something takes.
fn lap<T>(run: impl FnOnce() -> Result<T, Error>) -> Result<f64, Error> {
    let start = Instant::now();
    run()?;
    Ok(start.elapsed().as_secs_f64())
}
