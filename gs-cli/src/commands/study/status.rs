//! `gs study status`: how many runs of a study have ended, and who is doing others.

use gs_core::counted;

use super::{arguments::HeldStudyArgs, prepare::held};
use crate::{failure::Failure, flags::cluster::print_slurm_states, terminal::output};

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
    print_slurm_states(folder.path(), "study")
}
