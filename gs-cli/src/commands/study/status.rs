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
    let claimed: Vec<_> =
        plan.runs.iter().zip(folder.running(&plan)?).filter_map(|(run, by)| Some((run, by?))).collect();
    let running = claimed.iter().filter(|(_, by)| by.age.is_some()).count();
    output::result(format_args!(
        "{}: {ended} of {} ended, {running} under way, {} left by processes that died, {} free",
        plan.study.name,
        counted(plan.runs.len(), "run"),
        claimed.len() - running,
        plan.runs.len().saturating_sub(ended + claimed.len()),
    ))?;
    for (run, by) in &claimed {
        output::result(format_args!("row {} ({}): {by}", run.row, plan.describe(run)))?;
    }
    print_slurm_states(folder.path(), "study")
}
