//! Replays a row of a study. It must end in the recorded scene, bit for bit.

use super::{
    folder::StudyFolder,
    recorded,
    resumption::Interruptions,
    train::{Replayed, train},
};
use gs_core::{Optimizer, Scene2d, Scene3d};

use crate::{
    error::Error,
    study::{AnyPolicy, Machine, Plan, Run, VERSION},
};

/// What is recorded of a row.
struct End {
    address: String,
    scene: Option<String>,
    version: String,
    machine: Machine,
}

/// Replays a row of the study in `folder` and compares the scene with the recorded one. The tables
/// in the folder suffice; the files of the runs may be missing. `begun` is called first with the run.
///
/// # Errors
/// [`Error::NoRow`]; [`Error::Folder`] where the row has not been done; [`Error::Replay`] where the record
/// is of something else, before anything is computed, and where the scene differs from the recorded
/// one; [`Error::Arm`] where this program does not have the arm's policy; [`Error::Fit`] where the run
/// fails.
pub fn replay<R: Optimizer<Scene2d> + Optimizer<Scene3d>>(
    plan: &Plan,
    row: usize,
    rasterizer: &R,
    folder: &StudyFolder,
    begun: &dyn Fn(&Run),
) -> Result<Replayed, Error> {
    let run = recorded_run(plan, row, folder)?;
    begun(run);
    if let Some(recorded) = folder.machine().filter(|recorded| recorded.name != plan.machine.name) {
        return Err(other_machine(row, &recorded, &plan.machine));
    }
    let end = end(run, row, folder)?.ok_or_else(|| Error::Folder {
        folder: folder.path().to_owned(),
        what: format!("row {row} has not been done"),
        mend: "let gs study --resume do it first",
    })?;
    if end.address != run.address {
        return Err(difference(plan, run, &end));
    }
    let arm = plan.arm(run);
    if arm.own_policy.as_ref().is_some_and(|own| matches!(own.policy, AnyPolicy::Elsewhere)) {
        return Err(plan.policy_is_elsewhere(arm));
    }
    let differs = |recorded: &str, found: &str| {
        let message = format!(
            "the scene is not the recorded one ({found} instead of {recorded}), though nothing that is known differs"
        );
        Error::Replay { row, message }
    };
    let replayed = train(plan, run, rasterizer, Interruptions::new(run, &(), None))?
        .ok_or_else(|| differs(end.scene.as_deref().unwrap_or("none"), "none"))?;
    match &end.scene {
        Some(recorded) if *recorded != replayed.finished.scene => Err(differs(recorded, &replayed.finished.scene)),
        None => Err(differs("none: the run failed", &replayed.finished.scene)),
        Some(_) => Ok(replayed),
    }
}

/// The error that says how a run differs from the recorded one.
fn difference(plan: &Plan, run: &Run, end: &End) -> Error {
    let (row, recorded, found) = (run.row, &end.address, &run.address);
    if end.machine.name != plan.machine.name {
        return other_machine(row, &end.machine, &plan.machine);
    }
    let message = match end.version.as_str() {
        VERSION => format!(
            "its settings, its image or its data set are not those recorded (address {found} instead of {recorded}): \
             put study.toml and the data back as they were, or let gs study --resume do the row again"
        ),
        version => format!(
            "recorded by version {version}, but this is {VERSION}: replay it with that version, or do the study again"
        ),
    };
    Error::Replay { row, message }
}

fn other_machine(row: usize, recorded: &Machine, Machine { name, .. }: &Machine) -> Error {
    let hint = match recorded.flags.is_empty() {
        true => "replay it there".to_owned(),
        false => format!("add {}", recorded.typed_flags()),
    };
    Error::Replay { row, message: format!("recorded on {}, but this is {name}: {hint}", recorded.name) }
}

/// The run of a row in the folder's `runs.csv`. If only a part of the study was conducted last,
/// rows are those of the part.
///
/// # Errors
/// [`Error::NoRow`].
fn recorded_run<'p>(plan: &'p Plan, row: usize, folder: &StudyFolder) -> Result<&'p Run, Error> {
    let Some(recorded) = recorded::recorded(folder) else { return plan.run(row) };
    let rows = recorded.runs.len();
    let found = row.checked_sub(1).and_then(|index| recorded.runs.get(index)).ok_or(Error::NoRow { row, rows })?;
    match plan.runs.iter().find(|run| run.address == found.address) {
        Some(run) => Ok(run),
        // The error that follows is about the row of the whole study.
        None => plan.run(row),
    }
}

fn end(run: &Run, row: usize, folder: &StudyFolder) -> Result<Option<End>, Error> {
    if let Some(record) = folder.record(run)? {
        let scene = record.outcome.finished().map(|finished| finished.scene.clone());
        return Ok(Some(End { address: record.address, scene, version: record.version, machine: record.machine }));
    }
    Ok(recorded::recorded(folder).and_then(|recorded| {
        let row = recorded.runs.into_iter().nth(row - 1)?;
        let is_missing = row.scene.is_none() && row.address == run.address;
        let (version, machine) = (recorded.version, recorded.machine);
        (!is_missing).then_some(End { address: row.address, scene: row.scene, version, machine })
    }))
}
