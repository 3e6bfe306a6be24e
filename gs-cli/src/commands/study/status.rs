//! `gs study status`: how many runs of a study have ended, and who is doing others.

use std::{collections::BTreeMap, fs, path::Path, process::Command};

use gs_core::counted;

use super::{arguments::HeldStudyArgs, prepare::held, submit::SCRIPT};
use crate::{failure::Failure, terminal::output};

/// Prints the state of the study.
pub(super) fn run(args: &HeldStudyArgs) -> Result<(), Failure> {
    let held = held(args, false)?;
    let (folder, plan) = (&held.folder, held.plan_as_prepared()?);
    let ended = folder.ended()?;
    let ended = plan.runs.iter().filter(|run| ended.contains(&run.address)).count();
    let claimed = folder.running(&plan)?;
    let (running, left): (Vec<_>, Vec<_>) = claimed.iter().partition(|run| run.age.is_some());
    let free = plan.runs.len().saturating_sub(ended + claimed.len());
    output::result(format_args!(
        "{}: {ended} of {} ended, {} under way, {} left by processes that died, {free} free",
        plan.study.name,
        counted(plan.runs.len(), "run"),
        running.len(),
        left.len(),
    ))?;
    for run in &claimed {
        let worker = run.worker.as_deref().unwrap_or("a process that has just begun");
        let age = match run.age {
            Some(age) => format!("last sign of life {:.0} s ago", age.as_secs_f64()),
            None => "died".to_owned(),
        };
        output::result(format_args!("row {} ({}): {worker}: {age}", run.row, plan.describe(&plan.runs[run.row - 1])))?;
    }
    slurm_states(folder.path()).map_or(Ok(()), |states| output::result(format_args!("Slurm: {states}")))
}

/// The tasks of the study that Slurm knows, by their states; `None` without Slurm.
fn slurm_states(folder: &Path) -> Option<String> {
    let script = fs::canonicalize(folder.join(SCRIPT)).ok()?;
    let listed = Command::new("squeue").args(["--noheader", "--array", "--format=%T %o"]).output().ok()?;
    if !listed.status.success() {
        return Some(String::from_utf8_lossy(&listed.stderr).trim().to_owned());
    }
    let mut states = BTreeMap::<String, usize>::new();
    for line in String::from_utf8_lossy(&listed.stdout).lines() {
        if let Some((state, command)) = line.split_once(' ')
            && Path::new(command.trim()) == script
        {
            *states.entry(state.to_lowercase()).or_default() += 1;
        }
    }
    let states: Vec<String> =
        states.into_iter().map(|(state, tasks)| format!("{} {state}", counted(tasks, "task"))).collect();
    Some(if states.is_empty() { "no task of the study".to_owned() } else { states.join(", ") })
}
