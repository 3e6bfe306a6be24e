//! Conducts a study: runs its fits side by side, each on its own rasterizer, and stores each result
//! at once.

use gs_backend::FutureExt as _;
use std::{
    any::Any,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::Mutex,
    thread,
};

use gs_core::{
    Blend, Canvas, Error as CoreError, Gaussian2d, Image, Optimizer, Parameterization, RenderSettings, Scene2d,
};
use gs_train::{Control, Error as FitError, FitSummary, MetricsLog, Observer, Progress, Recovery, Trainer};

use crate::{
    digest,
    error::Error,
    folder::StudyFolder,
    plan::{Plan, Run, VERSION},
    queue::Queue,
    record::{Finished, Record, RunOutcome},
    replay::Replayed,
    work::WorkSettings,
};

/// Watches a study; called from several threads. `()` ignores everything.
pub trait Watcher: Sync {
    /// A run has begun.
    fn begun(&self, run: &Run) {
        let _ = run;
    }

    /// A run has ended, and its outcome is stored.
    fn ended(&self, run: &Run, outcome: &RunOutcome) {
        let _ = (run, outcome);
    }

    /// The folder has records of this many runs of the study, done by this process or others.
    fn counted(&self, ended: usize) {
        let _ = ended;
    }

    /// Whether to stop. Runs in progress are abandoned.
    fn wants_stop(&self) -> bool {
        false
    }
}

impl Watcher for () {}

/// How a study ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Conducted {
    /// Every run has ended.
    Whole,
    /// The watcher stopped the study; it can be resumed.
    Stopped,
    /// The runs that are left are with other processes: see [`AtEnd::Leave`](crate::study::AtEnd).
    Left,
}

/// Runs all fits of a plan that have no record, in the order of their rows, one at a time on each
/// rasterizer of `team`. Other processes may work in the same folder: each run is done by one.
///
/// Results depend neither on the size of the team nor on its threads. Runs that fail or panic are
/// recorded and do not stop the others. If a backend fails for good, no further run begins, and
/// nothing is recorded of the run in which it failed.
///
/// # Errors
/// [`Error::Arm`] as for [`refuse_unsupported`], [`Error::Backend`] where a backend fails for good,
/// [`Error::Io`] and [`Error::Path`] where a run cannot be claimed or its result not be stored, and
/// [`Error::TwoResults`] where a run that was taken over ended in two results.
pub fn conduct<R: Optimizer<Scene2d> + Sync>(
    plan: &Plan,
    team: &[&R],
    folder: &StudyFolder,
    watcher: &dyn Watcher,
) -> Result<Conducted, Error> {
    conduct_with(plan, team, folder, &WorkSettings::default(), watcher)
}

/// Runs fits as [`conduct`] does, beginning with a part of the study, or leaving before its end.
///
/// # Errors
/// As [`conduct`], and [`Error::Work`] for settings out of their range.
pub fn conduct_with<R: Optimizer<Scene2d> + Sync>(
    plan: &Plan,
    team: &[&R],
    folder: &StudyFolder,
    settings: &WorkSettings,
    watcher: &dyn Watcher,
) -> Result<Conducted, Error> {
    settings.validate()?;
    team.first().map_or(Ok(()), |rasterizer| refuse_unsupported(plan, *rasterizer))?;
    let queue = folder.queue(plan, settings);
    let trouble = Mutex::new(None);
    let work = |rasterizer: &R| {
        if let Err(error) = conduct_from(&queue, plan, rasterizer, team.len(), folder, watcher) {
            queue.close();
            trouble.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).get_or_insert(error);
        }
    };
    queue.keep_alive(|| {
        thread::scope(|scope| {
            for &rasterizer in team {
                scope.spawn(|| work(rasterizer));
            }
        });
    });
    match trouble.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner()) {
        Some(error) => Err(error),
        None if queue.left()? == 0 => Ok(Conducted::Whole),
        None if watcher.wants_stop() => Ok(Conducted::Stopped),
        None => Ok(Conducted::Left),
    }
}

/// Does runs of a queue until there are none, or the watcher stops.
fn conduct_from<R: Optimizer<Scene2d>>(
    queue: &Queue<'_>,
    plan: &Plan,
    rasterizer: &R,
    side_by_side: usize,
    folder: &StudyFolder,
    watcher: &dyn Watcher,
) -> Result<(), Error> {
    let words = |index: usize| plan.describe(&plan.runs[index]);
    while let Some((index, claim)) = queue.next(words, watcher)? {
        let run = &plan.runs[index];
        watcher.begun(run);
        // A claim that is dropped leaves the run to others.
        let Some((outcome, picture)) = attempt(plan, run, rasterizer, side_by_side, watcher)? else { return Ok(()) };
        // The picture is stored first, so that a recorded run has all its files.
        let shown = picture.filter(|_| is_shown(plan, run));
        shown.map_or(Ok(()), |picture| folder.store_picture(run, &picture))?;
        folder.store(plan, run, &record(plan, run, outcome.clone())?)?;
        claim.finish();
        watcher.ended(run, &outcome);
    }
    Ok(())
}

/// Fails where the backend does not support what an arm needs, before any run begins.
///
/// # Errors
/// [`Error::Arm`] with what is not supported.
pub fn refuse_unsupported<R: Optimizer<Scene2d>>(plan: &Plan, rasterizer: &R) -> Result<(), Error> {
    for (index, arm) in plan.study.arms.iter().enumerate() {
        let Some(run) = plan.runs.iter().find(|run| run.arm == index) else { continue };
        let settings = &run.settings;
        let mut render = settings.render;
        render.effects.statistics = match &arm.own_policy {
            Some(own) => own.policy.statistics(),
            None => settings.policy.statistics(),
        };
        if let Err(error @ CoreError::Unsupported { .. }) = draw_one(rasterizer, &render, settings.parameterization) {
            let (study, arm, line) = (plan.study.name.clone(), arm.name.clone(), arm.line);
            return Err(Error::Arm { study, line, arm, message: error.to_string() });
        }
    }
    Ok(())
}

/// Draws one Gaussian on one pixel, to find out what the backend supports.
fn draw_one<R: Optimizer<Scene2d>>(
    rasterizer: &R,
    render: &RenderSettings,
    parameterization: Parameterization,
) -> Result<(), CoreError> {
    let gaussian = Gaussian2d {
        mean: [0.5; 2].into(),
        log_scale: [0.0; 2].into(),
        rotation: 0.0,
        opacity_logit: if render.effects.blend == Blend::Sum { f32::INFINITY } else { 0.0 },
        color: [0.5; 3].into(),
    };
    let splats = rasterizer.upload(&[gaussian].into_iter().collect(), parameterization)?;
    rasterizer.forward(&splats, &Canvas::new(1, 1), render).block_on().map(drop)
}

/// Whether the backend still works.
fn answers<R: Optimizer<Scene2d>>(rasterizer: &R, run: &Run) -> bool {
    let drawn =
        catch_unwind(AssertUnwindSafe(|| draw_one(rasterizer, &run.settings.render, run.settings.parameterization)));
    !matches!(drawn, Err(_) | Ok(Err(CoreError::Backend { .. })))
}

/// Whether a run's picture is stored: only runs of the first seed.
fn is_shown(plan: &Plan, run: &Run) -> bool {
    plan.study.seeds.first() == Some(&run.seed)
}

/// Does a run. Returns `None` where the watcher stopped it, and an error where the backend failed
/// and does not recover, which says nothing about the run.
fn attempt<R: Optimizer<Scene2d>>(
    plan: &Plan,
    run: &Run,
    rasterizer: &R,
    side_by_side: usize,
    watcher: &dyn Watcher,
) -> Result<Option<(RunOutcome, Option<Image>)>, Error> {
    // A fit that panicked shares no state with others: its trainer was dropped.
    let fitted = catch_unwind(AssertUnwindSafe(|| fit(plan, run, rasterizer, watcher)));
    match fitted {
        Ok(Ok(Some(Replayed { image, finished, .. }))) => {
            let finished = Finished { side_by_side, ..finished };
            Ok(Some((RunOutcome::Finished(Box::new(finished)), Some(image))))
        }
        Ok(Ok(None)) => Ok(None),
        // A device with too little memory for this run may still have enough for others.
        Ok(Err(FitError::Core(source @ CoreError::Backend { .. }))) if !answers(rasterizer, run) => {
            Err(Error::Backend { row: run.row, run: plan.describe(run), source })
        }
        Ok(Err(error)) => Ok(Some((RunOutcome::Failed { error: error.to_string() }, None))),
        Err(panic) => Ok(Some((RunOutcome::Failed { error: format!("panicked: {}", message(panic.as_ref())) }, None))),
    }
}

fn message(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("without a message")
}

/// The fit of a run, with its scene, image and numbers; `None` where the watcher stopped it.
pub(crate) fn fit<R: Optimizer<Scene2d>>(
    plan: &Plan,
    run: &Run,
    rasterizer: &R,
    watcher: &dyn Watcher,
) -> Result<Option<Replayed>, FitError> {
    // A diverging arm must fail instead of recovering, so that the study shows it.
    let settings = run.settings.clone().with(|s| s.recovery = Recovery::Never);
    let mut trainer = Trainer::new(rasterizer, &plan.target(run).image, settings).block_on()?;
    if let Some(own) = &plan.arm(run).own_policy {
        trainer = trainer.controlled_by(own.policy.clone());
    }
    let mut log = MetricsLog::for_steps(run.settings.iterations);
    trainer.run(&mut (&mut log, StopWith(watcher))).block_on()?;
    if !trainer.is_finished() {
        return Ok(None);
    }
    let (image, culled) = trainer.render().block_on()?;
    let summary = FitSummary::new(&trainer, &image, culled).block_on()?;
    let scene = trainer.scene().block_on()?;
    let finished = Finished {
        gaussians: summary.gaussians,
        iterations: summary.iterations,
        psnr: summary.psnr,
        ssim: summary.ssim,
        ms_ssim: summary.ms_ssim,
        l1: summary.l1,
        loss: summary.loss,
        edits: summary.edits,
        culled: summary.culled,
        scene: digest::of_scene(&scene),
        seconds: summary.seconds,
        backend: summary.backend,
        side_by_side: 1,
        trajectory: log.rows().to_vec(),
    };
    Ok(Some(Replayed { scene, image, settings: trainer.shown(), finished }))
}

struct StopWith<'a>(&'a dyn Watcher);

impl Observer for StopWith<'_> {
    fn on_step(&mut self, _: &Progress) -> Control {
        if self.0.wants_stop() { Control::Stop } else { Control::Continue }
    }
}

fn record(plan: &Plan, run: &Run, outcome: RunOutcome) -> Result<Record, Error> {
    let target = plan.target(run);
    let settings = run
        .settings
        .to_toml()
        .map_err(|error| plan.study.wrong(error.to_string(), "change the settings of the arm"))?;
    Ok(Record {
        address: run.address.clone(),
        version: VERSION.to_owned(),
        machine: plan.machine.clone(),
        image: target.name.clone(),
        target: target.digest.clone(),
        policy: plan.arm(run).own_policy.as_ref().map(|own| own.fingerprint.clone()),
        settings,
        outcome,
    })
}
