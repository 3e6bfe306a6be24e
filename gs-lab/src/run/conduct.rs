//! Conducts a study: does its runs side by side, each on its own rasterizer, and stores each result
//! at once.

use std::{
    any::Any,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::Mutex,
    thread,
};

use gs_core::{Error as CoreError, Image, Optimizer, Scene2d, Scene3d};
use gs_jobs::{Queue, WorkSettings};
use gs_train::Error as TrainError;

use super::{
    folder::StudyFolder,
    record::{Finished, Record, RunOutcome},
    resumption::{Interruptions, JobCheckpoints, remove_checkpoint},
    task::StudyBackend,
    train::train,
    watcher::Watcher,
};
use crate::{
    error::Error,
    study::{Clock, Plan, Run, VERSION},
};

/// How a study ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Conducted {
    /// Every run has ended.
    Whole,
    /// The watcher stopped the study; it can be resumed.
    Stopped,
    /// The runs that are left are with other processes: see [`AtEnd::Leave`](gs_jobs::AtEnd).
    Left,
}

impl Conducted {
    /// What has become of the jobs of a queue.
    pub(crate) fn of(queue: &Queue<'_>, is_stopped: bool) -> Result<Self, Error> {
        Ok(match queue.left()? {
            0 => Self::Whole,
            _ if is_stopped => Self::Stopped,
            _ => Self::Left,
        })
    }
}

/// Does all runs of a plan that have no record.
///
/// Each rasterizer of `team` does one run at a time, and runs begin in the order of their rows.
/// `settings` can choose a part of the study to begin with, or end the work before the whole study
/// is done. Other processes may work in the same folder: each run is done by one process.
///
/// Results depend neither on the size of the team nor on its threads. Runs that fail or panic are
/// recorded and do not stop the others. If a backend fails for good, no further run begins, and
/// nothing is recorded of the run in which it failed.
///
/// # Errors
/// - Those of [`refuse_unsupported`].
/// - [`Error::Backend`] where a backend fails for good.
/// - [`Error::Io`] and [`Error::Path`] where a run cannot be claimed or its result cannot be
///   stored.
/// - [`Error::TwoResults`] where a run was taken over and both processes ended it, in two results.
/// - [`Error::Work`] for settings out of their range, and for a team that the study's clock does
///   not allow.
pub fn conduct<R: Optimizer<Scene2d> + Optimizer<Scene3d> + Sync>(
    plan: &Plan,
    team: &[&R],
    folder: &StudyFolder,
    settings: &WorkSettings,
    watcher: &dyn Watcher,
) -> Result<Conducted, Error> {
    settings.validate()?;
    plan.study.clock.check_team(team.len())?;
    team.first().map_or(Ok(()), |rasterizer| refuse_unsupported(plan, *rasterizer))?;
    let queue = folder.queue(plan, settings);
    let trouble = Mutex::new(None);
    let work = |rasterizer: &R| {
        let at = Place { plan, folder, settings, side_by_side: team.len(), watcher };
        if let Err(error) = conduct_from(&queue, rasterizer, &at) {
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
        None => Conducted::of(&queue, watcher.wants_stop()),
    }
}

/// What all runs of a process have in common.
struct Place<'a> {
    plan: &'a Plan,
    folder: &'a StudyFolder,
    settings: &'a WorkSettings,
    side_by_side: usize,
    watcher: &'a dyn Watcher,
}

/// Does runs of a queue until there are none, or the watcher stops.
fn conduct_from<R: StudyBackend>(queue: &Queue<'_>, rasterizer: &R, at: &Place<'_>) -> Result<(), Error> {
    let &Place { plan, folder, watcher, .. } = at;
    let words = |index: usize| plan.describe(&plan.runs[index]);
    while let Some((index, claim)) = queue.next(words, &watcher)? {
        let run = &plan.runs[index];
        watcher.begun(run);
        // A claim that is dropped leaves the run to others.
        let Some((outcome, pictures)) = attempt(run, rasterizer, at)? else { return Ok(()) };
        // Pictures are stored first, so that a recorded run has all its files.
        if is_shown(plan, run) {
            pictures.iter().enumerate().try_for_each(|(index, picture)| folder.store_picture(run, index, picture))?;
        }
        folder.store_record(plan, run, &record(plan, run, outcome.clone())?)?;
        remove_checkpoint(folder.store(), &run.address);
        claim.finish();
        watcher.ended(run, &outcome);
    }
    Ok(())
}

/// Checks, before any run begins, that this program and the backend can do the runs of a plan.
///
/// # Errors
/// [`Error::Arm`] where the backend does not support the effects of an arm, or where this program
/// does not have the arm's policy; [`Error::Study`] where the study's clock does not count what the
/// backend does.
pub fn refuse_unsupported<R>(plan: &Plan, rasterizer: &R) -> Result<(), Error>
where
    R: Optimizer<Scene2d> + Optimizer<Scene3d>,
{
    let backend = rasterizer.describe();
    if plan.study.clock == Clock::Cpu && !backend.starts_with("cpu") {
        let what = format!("clock: CPU time says nothing about {backend}");
        return Err(plan.study.wrong(what, "choose --backend cpu, or leave the clock out"));
    }
    for (index, arm) in plan.study.arms.iter().enumerate() {
        let Some(run) = plan.runs.iter().find(|run| run.arm == index) else { continue };
        let mut render = *run.settings.render();
        render.effects.statistics = match &arm.own_policy {
            Some(own) => own.policy.statistics().ok_or_else(|| plan.policy_is_elsewhere(arm))?,
            None => run.settings.statistics(),
        };
        if let Err(error @ CoreError::Unsupported { .. }) = run.settings.draw_one(rasterizer, &render) {
            let (study, arm) = (plan.study.name.clone(), arm.name.clone());
            return Err(Error::Arm { study, arm, message: error.to_string() });
        }
    }
    Ok(())
}

/// Whether the backend still works.
fn answers<R: StudyBackend>(rasterizer: &R, run: &Run) -> bool {
    let drawn = catch_unwind(AssertUnwindSafe(|| run.settings.draw_one(rasterizer, run.settings.render())));
    !matches!(drawn, Err(_) | Ok(Err(CoreError::Backend { .. })))
}

/// Whether a run's pictures are stored: only runs of the first seed.
fn is_shown(plan: &Plan, run: &Run) -> bool {
    plan.study.seeds.first() == Some(&run.seed)
}

/// Does a run. Returns `None` where the watcher stopped it, and an error where the backend failed
/// and does not recover, which says nothing about the run.
fn attempt<R: StudyBackend>(
    run: &Run,
    rasterizer: &R,
    at: &Place<'_>,
) -> Result<Option<(RunOutcome, Vec<Image>)>, Error> {
    let &Place { plan, side_by_side, watcher, .. } = at;
    let checkpoints = JobCheckpoints::new(at.folder.store(), &run.address, at.settings.lease);
    // A run that panicked shares no state with others: its trainer was dropped.
    let trained =
        catch_unwind(AssertUnwindSafe(|| train(plan, run, rasterizer, Interruptions::new(run, watcher, checkpoints))));
    let failed = |error: String| Ok(Some((RunOutcome::Failed { error }, Vec::new())));
    match trained {
        Ok(Ok(Some((finished, pictures)))) => {
            let finished = Finished { side_by_side, ..finished };
            Ok(Some((RunOutcome::Finished(Box::new(finished)), pictures)))
        }
        Ok(Ok(None)) => Ok(None),
        // A device with too little memory for this run may still have enough for others.
        Ok(Err(TrainError::Core(source @ CoreError::Backend { .. }))) if !answers(rasterizer, run) => {
            Err(Error::Backend { row: run.row, run: plan.describe(run), source })
        }
        Ok(Err(error)) => failed(error.to_string()),
        Err(panic) => failed(format!("panicked: {}", message(panic.as_ref()))),
    }
}

pub(crate) fn message(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("without a message")
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
