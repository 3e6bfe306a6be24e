//! `gs blocks work`: trains blocks that other processes work on, too.

use gs_core::counted;
use gs_lab::{
    blocks::{BlocksFolder, conduct},
    study::Machine,
};

use super::{
    arguments::WorkArgs,
    folder_and_views::{open, views},
};
use crate::{failure::Failure, flags::cluster::WorkLog, memory::Need, terminal::output};

/// Trains blocks until none is left for this process.
pub(super) fn run(args: &WorkArgs) -> Result<(), Failure> {
    let folder = open(&args.folder)?;
    let views = views(&folder, &args.data)?;
    let prepared = &folder.origin().machine;
    let backend = args.backend.or_recorded(prepared).open().map_err(|failure| {
        let hint = "blocks have one backend and SIMD level for all machines: prepare them with one that all have";
        failure.at(format_args!("the blocks are for {}", prepared.name)).hint(hint)
    })?;
    folder.check(&Machine::of(&backend.rasterizer))?;
    if args.retry {
        folder.forget_failures()?;
    }
    check_memory(&folder)?;
    output::note(&backend.reason);
    let blocks = &folder.plan().blocks;
    let name = |block: &usize| {
        let (steps, views) = (counted(blocks[*block].steps, "step"), counted(blocks[*block].views.len(), "view"));
        format!("block {} of {} ({steps}, {views})", block + 1, blocks.len())
    };
    let log = WorkLog::begin(&name);
    let conducted = conduct(&folder, &backend.rasterizer, &views, &args.worker.settings(), &log)?;
    log.end(conducted, ["block", "blocks", "join them with gs blocks merge"], folder.path())
}

/// Fails where this process may not have the memory of some block that has not ended.
fn check_memory(folder: &BlocksFolder) -> Result<(), Failure> {
    for (block, planned) in folder.plan().blocks.iter().enumerate() {
        if folder.record(block)?.is_none() {
            let what = format!("block {} of {}", block + 1, folder.path().display());
            Need { what, bytes: planned.memory, held: 0, less: "prepare more blocks" }.check()?;
        }
    }
    Ok(())
}
