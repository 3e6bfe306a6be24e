//! `gs study submit`: hands a study to Slurm as an array of jobs.

use gs_io::Inputs;

use super::{
    arguments::SubmitArgs,
    prepare::{Prepared, prepare},
};
use crate::{
    failure::Failure,
    flags::cluster::{SCRIPT, absolute},
    terminal::output::{self, quoted},
};

/// Makes the folder of a study, writes the script, and submits it.
pub(super) fn run(args: &SubmitArgs) -> Result<(), Failure> {
    let Prepared { folder, backends, words, places, .. } = prepare(&args.study, 1)?;
    output::note(&backends[0].reason);
    let path = absolute(folder.path())?;
    let data = places.data.as_deref().map(absolute).transpose()?;
    let data = data.map_or_else(String::new, |data| format!(" --data {}", quoted(&data)));
    let claim = args.study.overwrite.claim(&path, [SCRIPT], Inputs::default());
    let said = args.slurm.submit(claim, "study work", &format!(" --jobs {}{data}", args.jobs))?;
    output::result(format_args!("{words}: {said}; see gs study status {}", quoted(&path)))
}
