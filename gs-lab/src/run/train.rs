//! Does one run of a study, from its beginning or its checkpoint on.

use gs_backend::FutureExt as _;
use gs_core::{Error as CoreError, Image, Optimizer, Scene2d, Scene3d};
use gs_io::Checkpoint;
use gs_train::{Error as TrainError, RunSettings as _, Trainer};

use super::{
    record::Finished,
    resumption::Interruptions,
    task::{StudyBackend, StudyTask},
    trajectory::Trajectory,
};
use crate::study::{ArmSettings, Plan, Run};

/// Does a run, from its checkpoint on if it has one. Returns its numbers, and renderings of the scene that
/// are not clamped: at the target's size, or for each of the held-out views that are shown; `None` where
/// the watcher stopped it.
pub(crate) fn train<R: StudyBackend>(
    plan: &Plan,
    run: &Run,
    rasterizer: &R,
    interruptions: Interruptions<'_>,
) -> Result<Option<(Finished, Vec<Image>)>, TrainError> {
    match &run.settings {
        ArmSettings::Image(settings) => train_task::<Scene2d, R>(plan, run, settings, rasterizer, interruptions),
        ArmSettings::Scene(settings) => train_task::<Scene3d, R>(plan, run, settings, rasterizer, interruptions),
    }
}

fn train_task<S: StudyTask, R: Optimizer<S>>(
    plan: &Plan,
    run: &Run,
    settings: &S::Settings,
    rasterizer: &R,
    interruptions: Interruptions<'_>,
) -> Result<Option<(Finished, Vec<Image>)>, TrainError> {
    let arm = plan.arm(run);
    let (mut trainer, mut trajectory) = begin::<S, R>(plan, run, settings, rasterizer, &interruptions)?;
    if let Some(policy) = arm.own_policy.as_ref().and_then(|own| S::own(&own.policy)) {
        trainer = trainer.controlled_by(policy.clone());
    }
    trainer.run(&mut (&mut trajectory, interruptions)).block_on()?;
    if !trainer.is_finished() {
        return Ok(None);
    }
    let scene = trainer.scene().block_on()?;
    let mut finished = Finished {
        gaussians: trainer.count(),
        bytes: scene.bytes(),
        iterations: trainer.step(),
        edits: *trainer.edits(),
        scene: scene.digest(),
        seconds: trainer.seconds(),
        backend: trainer.backend(),
        side_by_side: 1,
        trajectory: trajectory.rows().to_vec(),
        ..Finished::default()
    };
    let pictures = S::measure(&trainer, plan.study.align_poses, &mut finished)?;
    let with_curves = if plan.study.align_poses { &mut [] } else { &mut finished.views[..] };
    for (index, view) in with_curves.iter_mut().enumerate() {
        view.curve = trajectory.curve(index);
    }
    for &measure in &plan.study.measure {
        finished.measured.extend(S::further(measure, rasterizer, plan.target(run), settings, &scene)?);
    }
    finished.measured.retain(|_, value| value.is_finite());
    Ok(Some((finished, pictures)))
}

/// Begins a run, or goes on from its checkpoint.
fn begin<'r, S: StudyTask, R: Optimizer<S>>(
    plan: &Plan,
    run: &Run,
    settings: &S::Settings,
    rasterizer: &'r R,
    interruptions: &Interruptions<'_>,
) -> Result<(Trainer<'r, R, S>, Trajectory), TrainError> {
    let (arm, target, iterations) = (plan.arm(run), plan.target(run), settings.of_loop().iterations);
    let clock = plan.study.clock;
    let resume = |checkpoint: Checkpoint| {
        let trajectory = Trajectory::resumed(iterations, &checkpoint.metadata)?;
        Ok((clock.go_on(S::resume(rasterizer, target, (arm, run.seed), checkpoint)?), trajectory))
    };
    match interruptions.checkpoint().map(resume) {
        Some(Ok(resumed)) => {
            interruptions.resumed(resumed.0.step());
            return Ok(resumed);
        }
        Some(Err(error @ TrainError::Core(CoreError::Backend { .. }))) => return Err(error),
        Some(Err(error)) => interruptions.refuse(error),
        None => {}
    }
    // A diverging arm must fail instead of recovering, so that the study shows it.
    let trainer = S::begin(rasterizer, target, arm, S::without_recovery(settings), clock)?;
    Ok((trainer, Trajectory::begun(iterations)))
}
