//! `gs study work`: does runs of a study that other processes work on, too.

use gs_backend::Chosen;
use gs_lab::{
    conduct,
    study::{Machine, Run},
};

use super::{
    arguments::WorkArgs,
    prepare::{held, rasterizers},
};
use crate::{failure::Failure, flags::cluster::WorkLog, terminal::output};

/// Does runs until none is left for this process.
pub(super) fn run(args: &WorkArgs) -> Result<(), Failure> {
    let held = held(&args.study, false)?;
    let folder = &held.folder;
    let backends = open(args, folder.machine())?;
    let plan = held.plan(Machine::of(&backends[0].rasterizer))?;
    folder.check(&plan)?;
    output::note(&backends[0].reason);
    let name = |run: &Run| format!("row {} ({})", run.row, plan.describe(run));
    let log = WorkLog::begin(&name);
    let conducted = conduct(&plan, &rasterizers(&backends), folder, &args.worker.settings(), &log)?;
    log.end(conducted, ["run", "study", "see gs study report"], folder.path())
}

/// The backends of the study, or those that the flags ask for.
fn open(args: &WorkArgs, recorded: Option<Machine>) -> Result<Vec<Chosen>, Failure> {
    let Some(recorded) = recorded else { return args.backend.open_several(args.jobs.into()) };
    args.backend.or_recorded(&recorded).open_several(args.jobs.into()).map_err(|failure| {
        let hint = "a study has one backend and SIMD level for all machines: prepare it with one that all have";
        failure.at(format_args!("the study is on {}", recorded.name)).hint(hint)
    })
}
