//! `gs blocks submit`: hands blocks to Slurm as an array of jobs.

use gs_core::counted;
use gs_io::Inputs;

use super::{arguments::SubmitArgs, folder_and_views::open};
use crate::{
    failure::Failure,
    flags::cluster::{SCRIPT, absolute},
    terminal::output::{self, quoted},
};

/// Writes the script, and submits it.
pub(super) fn run(args: &SubmitArgs) -> Result<(), Failure> {
    let folder = open(&args.folder)?;
    let path = absolute(folder.path())?;
    let data = args.data.data.as_deref().map(absolute).transpose()?;
    let data = data.map_or_else(String::new, |data| format!(" --data {}", quoted(&data)));
    let claim = args.overwrite.claim(&path, [SCRIPT], Inputs::default());
    let said = args.slurm.submit(claim, "blocks work", &data)?;
    let blocks = counted(folder.plan().blocks.len(), "block");
    output::result(format_args!("{blocks}: {said}; see gs blocks status {}", quoted(&path)))
}
