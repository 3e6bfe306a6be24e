//! `gs blocks`: trains a large scene in blocks.

mod arguments;
mod merge;
mod prepare;
mod status;
mod submit;
mod work;

use gs_io::dataset::read_dataset;
use gs_lab::blocks::BlocksFolder;
use gs_train::train::Views;

pub(crate) use self::arguments::BlocksArgs;
use self::arguments::{BlocksAction, DataArgs, FolderArgs};
use crate::{failure::Failure, flags::dataset::DatasetArgs};

/// Memory for the images of a block; those that exceed it are in a file, or read again.
const IMAGE_MEMORY: u64 = 500_000_000;

/// Does an action.
pub(crate) fn run(args: &BlocksArgs) -> Result<(), Failure> {
    match &args.action {
        BlocksAction::Prepare(args) => prepare::run(args),
        BlocksAction::Work(args) => work::run(args),
        BlocksAction::Submit(args) => submit::run(args),
        BlocksAction::Status(args) => status::run(args),
        BlocksAction::Merge(args) => merge::run(args),
    }
}

/// The blocks of a folder.
fn open(args: &FolderArgs) -> Result<BlocksFolder, Failure> {
    Ok(BlocksFolder::open(&args.folder)?)
}

/// The views of the data set of blocks.
fn views(folder: &BlocksFolder, args: &DataArgs) -> Result<Views, Failure> {
    let origin = folder.origin();
    let reading: DatasetArgs = serde_json::from_value(origin.reading.clone())
        .map_err(|error| Failure::failed(error).at(folder.path().join("blocks.json").display()))?;
    let path = args.data.as_deref().unwrap_or(&origin.dataset);
    let dataset = read_dataset(path, &reading.settings().with(|s| s.frame = Some(origin.frame)));
    let dataset = dataset.map_err(|error| {
        let failure = Failure::from(error);
        if args.data.is_some() {
            failure
        } else {
            failure.hint("name the data set's place on this machine with --data")
        }
    })?;
    Ok(Views { keep_bytes: IMAGE_MEMORY, cache_folder: Some(std::env::temp_dir()), ..Views::of_dataset(&dataset) })
}
