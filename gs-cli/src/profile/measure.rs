//! Measures a subject on a backend: the stages, as the backend sees them, and whole passes, as a caller sees them.

use pollster::FutureExt as _;
use std::time::Instant;

use gs_core::{
    Binning, Error, Loss, Optimizer, Parameterization, RenderSettings, Scene, Scene2d, Scene3d, TrainStep, Wait,
    profile::{Profiler, still},
};

use crate::{
    backend::{Backend, Task, Task3d},
    failure::Failure,
    profile::{
        report::{Facts, Report, SceneKind},
        scene3d::Subject3d,
        subject::{Compared, Subject},
    },
};

/// Training steps that are sent one behind the other before the last is waited for, as a fit does.
const STEPS: u32 = 4;

/// Profiling as a task for any backend.
pub(crate) struct Measure<'a, S> {
    pub(crate) subject: S,
    pub(crate) backend: &'a Backend,
    pub(crate) repetitions: usize,
}

/// The Gaussians, where they are seen from, and the image that they are compared with.
pub(crate) struct Ready<S: Scene> {
    pub(crate) scene: S,
    pub(crate) view: S::View,
    pub(crate) target: Compared,
    pub(crate) render: RenderSettings,
    pub(crate) loss: Loss,
    pub(crate) parameterization: Parameterization,
    /// Steps in which they were fitted.
    pub(crate) fitted_steps: Option<u32>,
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

impl Task for Measure<'_, Subject> {
    type Output = Result<Report, Failure>;

    fn run<R: Profiler<Scene2d>>(self, rasterizer: &R) -> Result<Report, Failure> {
        let Self { subject, backend, repetitions } = self;
        let about =
            About { kind: SceneKind::TwoD, input: subject.file.clone(), name: subject.name.clone(), repetitions };
        about.report(rasterizer, subject.prepare(rasterizer)?, backend)
    }
}

impl Task3d for Measure<'_, Subject3d> {
    type Output = Result<Report, Failure>;

    fn run<R: Profiler<Scene3d>>(self, rasterizer: &R) -> Result<Report, Failure> {
        let Self { subject, backend, repetitions } = self;
        let about = About {
            kind: SceneKind::ThreeD,
            input: Some(subject.name.clone()),
            name: subject.name.clone(),
            repetitions,
        };
        about.report(rasterizer, subject.prepare(rasterizer)?, backend)
    }
}

/// What of a report is the same for both kinds of scenes.
struct About {
    kind: SceneKind,
    input: Option<String>,
    name: String,
    repetitions: usize,
}

impl About {
    fn report<S: Scene, R: Profiler<S>>(
        self,
        rasterizer: &R,
        ready: Ready<S>,
        backend: &Backend,
    ) -> Result<Report, Failure> {
        let Self { kind, input, name, repetitions } = self;
        let Ready { scene, view, target, render, loss, parameterization, fitted_steps } = ready;
        let mut splats = rasterizer.upload(&scene, parameterization)?;
        let uploaded = rasterizer.upload_target(&target.image)?;
        let profile = rasterizer.profile(&mut splats, &view, &uploaded, &render, loss, repetitions).block_on()?;
        let rates = still();
        let step = TrainStep { settings: &render, loss, rates: &rates, binning: Binning::Fresh };
        let whole = whole(rasterizer, &mut splats, (&view, &uploaded), &step, repetitions)?;
        let facts = Facts {
            kind,
            input,
            name,
            gaussians: scene.len(),
            fitted_steps,
            target: target.name,
            size: target.image.size(),
            effects: render.effects,
            loss,
            parameterization,
            repetitions,
        };
        Ok(Report::new(facts, backend, &profile, &whole))
    }
}

/// Runs whole passes, interleaved, after one of each without looking at the clock. The rates of `step` should be such that the
/// Gaussians stay where they are.
fn whole<S: Scene, R: Optimizer<S>>(
    rasterizer: &R,
    splats: &mut R::Splats,
    (view, target): (&S::View, &R::Target),
    step: &TrainStep<'_>,
    repetitions: usize,
) -> Result<Whole, Error> {
    let (mut whole, mut losses) = (Whole::default(), Vec::new());
    let mut train = |splats: &mut R::Splats, binning: Binning| {
        let start = Instant::now();
        for _ in 0..STEPS {
            rasterizer.train_step(splats, view, target, &TrainStep { binning, ..*step }).block_on()?;
        }
        losses.clear();
        rasterizer.losses(splats, Wait::All, &mut losses).block_on()?;
        Ok(start.elapsed().as_secs_f64() / f64::from(STEPS))
    };
    for repetition in 0..=repetitions {
        // Lists must be made before they can be used again.
        let fresh = train(splats, Binning::Fresh)?;
        let reused = train(splats, Binning::Reuse)?;
        let start = Instant::now();
        let frame = rasterizer.forward(splats, view, step.settings).block_on()?;
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
