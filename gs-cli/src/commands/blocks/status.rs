//! `gs blocks status`: which blocks have ended, and who is doing others.

use gs_core::counted;
use gs_lab::blocks::BlockOutcome;

use super::{arguments::FolderArgs, folder_and_views::open};
use crate::{failure::Failure, flags::cluster::print_slurm_states, terminal::output};

/// Prints a line for each block.
pub(super) fn run(args: &FolderArgs) -> Result<(), Failure> {
    let folder = open(args)?;
    let (blocks, running) = (&folder.plan().blocks, folder.running()?);
    let mut ended = 0;
    let mut lines = Vec::new();
    for (block, (planned, running)) in blocks.iter().zip(running).enumerate() {
        let state = match (folder.record(block)?.map(|record| record.outcome), running) {
            (Some(outcome), _) => {
                ended += usize::from(matches!(outcome, BlockOutcome::Finished { .. }));
                outcome.to_string()
            }
            (None, Some(holder)) => holder.to_string(),
            (None, None) => "free".to_owned(),
        };
        let (views, steps) = (counted(planned.views.len(), "view"), counted(planned.steps, "step"));
        lines.push(format!("block {} ({views}, {steps}): {state}", block + 1));
    }
    output::result(format_args!("{ended} of {} done", counted(blocks.len(), "block")))?;
    lines.iter().try_for_each(output::result)?;
    print_slurm_states(folder.path(), "blocks")
}
