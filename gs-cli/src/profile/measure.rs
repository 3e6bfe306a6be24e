//! Measures a subject on a backend: the stages, as the backend sees them, and whole passes, as a caller sees them.

use std::time::Instant;

use gs_core::{
    Binning, Canvas, Error, PlanarScene, Rasterizer, Scene, TrainStep, Wait,
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

/// Training steps that are sent one behind the other before the last is waited for, as a fit does.
const STEPS: u32 = 4;

/// Profiling as a task for any backend.
pub(crate) struct Measure<'a> {
    pub(crate) subject: Subject,
    pub(crate) backend: &'a Backend,
    pub(crate) repetitions: usize,
}

/// Seconds of whole passes, one each per repetition; of training steps, means over [`STEPS`].
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
    let (mut whole, mut losses) = (Whole::default(), Vec::new());
    let mut train = |cloud: &mut R::Cloud, binning: Binning| {
        let start = Instant::now();
        for _ in 0..STEPS {
            rasterizer.train_step(cloud, canvas, target, &TrainStep { binning, ..*step })?;
        }
        losses.clear();
        rasterizer.losses(cloud, Wait::All, &mut losses)?;
        Ok(start.elapsed().as_secs_f64() / f64::from(STEPS))
    };
    for repetition in 0..=repetitions {
        // Lists must be made before they can be used again.
        let fresh = train(cloud, Binning::Fresh)?;
        let reused = train(cloud, Binning::Reuse)?;
        let start = Instant::now();
        let frame = rasterizer.forward(cloud, canvas, step.settings)?;
        let forward = start.elapsed().as_secs_f64();
        drop(frame);
        if repetition > 0 {
            whole.train_step_fresh.push(fresh);
            whole.train_step_reused.push(reused);
            whole.forward.push(forward);
        }
    }
    Ok(whole)
}
