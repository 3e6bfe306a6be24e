//! Measures a scene on a backend: the stages, as the backend times them, and whole passes, as a
//! caller sees them.

use std::time::Instant;

use gs_backend::{AnyRasterizer, Chosen, FutureExt as _};
use gs_core::{
    Binning, Error, Image, Loss, Parameterization, Rasterizer, RenderSettings, Scene, TrainStep, Wait,
    profile::{Profiler, still},
};

use super::report::{Report, SceneKind};
use crate::failure::Failure;

/// Training steps that are sent before the last is waited for, as in a fit.
const STEPS: u32 = 4;

/// What is measured.
pub(super) struct Subject<S: Scene> {
    pub(super) kind: SceneKind,
    /// The file; `None` is the paper's circle and square.
    pub(super) input: Option<String>,
    /// The name for messages.
    pub(super) name: String,
    pub(super) scene: S,
    pub(super) view: S::View,
    pub(super) target: Target,
    pub(super) render: RenderSettings,
    pub(super) loss: Loss,
    pub(super) parameterization: Parameterization,
    /// Steps in which the scene was fitted.
    pub(super) fitted_steps: Option<u32>,
}

/// The target of training steps.
pub(super) struct Target {
    pub(super) image: Image,
    pub(super) name: String,
}

impl Target {
    /// The default: the scene's own rendering.
    pub(super) fn own(rendering: Image) -> Self {
        Self { image: rendering, name: "its own rendering".to_owned() }
    }
}

/// Seconds of whole passes, one for each repetition; for training steps, means over [`STEPS`].
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Whole {
    /// Training steps that make new lists.
    pub(super) train_step_fresh: Vec<f64>,
    /// Training steps with the lists of the step before.
    pub(super) train_step_reused: Vec<f64>,
    /// Forward passes alone.
    pub(super) forward: Vec<f64>,
}

/// Measures a subject.
pub(super) fn measure<S: Scene>(subject: Subject<S>, backend: &Chosen, repetitions: usize) -> Result<Report, Failure>
where
    AnyRasterizer: Profiler<S>,
{
    let (rasterizer, Subject { view, render, loss, .. }) = (&backend.rasterizer, &subject);
    let mut splats = rasterizer.upload(&subject.scene, subject.parameterization)?;
    let target = Rasterizer::<S>::upload_target(rasterizer, &subject.target.image)?;
    let profile = rasterizer.profile(&mut splats, view, &target, render, *loss, repetitions).block_on()?;
    let rates = still();
    let step = TrainStep { settings: render, loss: *loss, rates: &rates, binning: Binning::Fresh };
    let whole = whole(rasterizer, &mut splats, (view, &target), &step, repetitions)?;
    Ok(Report::new(&subject, backend, &profile, &whole, repetitions))
}

/// Runs whole passes, interleaved, after one of each that is not timed. The rates of `step` should
/// leave the Gaussians where they are.
fn whole<S: Scene, R: Profiler<S>>(
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
        // The second makes use of the lists of the first.
        let fresh = train(splats, Binning::Fresh)?;
        let reused = train(splats, Binning::Reuse)?;
        let start = Instant::now();
        let pass = rasterizer.forward(splats, view, step.settings).block_on()?;
        let forward = start.elapsed().as_secs_f64();
        drop(pass);
        if repetition > 0 {
            whole.train_step_fresh.push(fresh);
            whole.train_step_reused.push(reused);
            whole.forward.push(forward);
        }
    }
    Ok(whole)
}
