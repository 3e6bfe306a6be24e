//! A row of a study, done again: it ends in the recorded scene, bit for bit, or the difference is an error.

use gs_core::{Image, PlanarScene, Rasterizer};

use crate::{
    conduct,
    error::Error,
    export,
    folder::StudyFolder,
    plan::{Plan, Run},
    record::Finished,
};

/// What came of a replay.
#[derive(Debug, Clone, PartialEq)]
pub struct Replayed {
    /// The scene: the recorded one.
    pub scene: PlanarScene,
    /// What it looks like at the target's size, not clamped.
    pub image: Image,
    /// The numbers; times are those of the replay.
    pub finished: Finished,
}

/// What is known of a row's end.
struct End {
    address: String,
    scene: Option<String>,
    version: String,
    machine: String,
}

/// Does a row of the study in `folder` again, and holds the scene against the recorded one. The tables are enough: the runs' own files
/// may be gone.
///
/// # Errors
/// [`Error::NoRow`]; [`Error::Folder`] where the row has not been done; [`Error::NotReplayed`] where it was computed from something else
/// (another version, machine, image), or its scene is another; [`Error::Fit`] where it fails, as it may have done in the study.
pub fn replay<R: Rasterizer<PlanarScene>>(
    plan: &Plan,
    row: usize,
    rasterizer: &R,
    folder: &StudyFolder,
) -> Result<Replayed, Error> {
    let run = plan.run(row)?;
    let end = end(run, folder).ok_or_else(|| Error::Folder {
        folder: folder.path().to_owned(),
        what: format!("row {row} has not been done"),
        mend: "let gs study --resume do it first",
    })?;
    let differs = |recorded: &str, found: &str| Error::NotReplayed {
        row,
        recorded: recorded.to_owned(),
        found: found.to_owned(),
        version: end.version.clone(),
        machine: end.machine.clone(),
    };
    if end.address != run.address {
        return Err(differs(&format!("address {}", end.address), &format!("address {}", run.address)));
    }
    let (scene, image, finished) = conduct::fit(plan, run, rasterizer, &())?
        .ok_or_else(|| differs(end.scene.as_deref().unwrap_or("none"), "none"))?;
    match &end.scene {
        Some(recorded) if *recorded != finished.scene => Err(differs(recorded, &finished.scene)),
        None => Err(differs("none: the run failed", &finished.scene)),
        Some(_) => Ok(Replayed { scene, image, finished }),
    }
}

fn end(run: &Run, folder: &StudyFolder) -> Option<End> {
    if let Some(record) = folder.record(run) {
        let scene = record.outcome.finished().map(|finished| finished.scene.clone());
        return Some(End { address: record.address, scene, version: record.version, machine: record.machine });
    }
    let recorded = export::recorded(folder)?;
    let row = recorded.runs.into_iter().nth(run.row - 1)?;
    if row.scene.is_none() && row.address == run.address {
        return None;
    }
    Some(End { address: row.address, scene: row.scene, version: recorded.version, machine: recorded.machine })
}
