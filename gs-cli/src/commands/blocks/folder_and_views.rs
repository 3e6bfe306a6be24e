//! The blocks of a folder, and the views of their data set.

use gs_io::dataset::read_dataset;
use gs_lab::blocks::BlocksFolder;
use gs_train::train::Views;

use super::arguments::{DataArgs, FolderArgs};
use crate::{failure::Failure, flags::dataset::DatasetArgs};

/// Memory for the images of a block; those that exceed it are in a file, or read again.
pub(super) const IMAGE_MEMORY: u64 = 500_000_000;

/// The blocks of a folder.
pub(super) fn open(args: &FolderArgs) -> Result<BlocksFolder, Failure> {
    Ok(BlocksFolder::open(&args.folder)?)
}

/// The views of the data set of blocks.
pub(super) fn views(folder: &BlocksFolder, args: &DataArgs) -> Result<Views, Failure> {
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
