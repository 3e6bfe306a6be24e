//! The files of the results, and the folder of unfinished work.

use std::{fs, path::Path};

use crate::error::Error;

/// The files that finding poses writes into the folder of a data set, besides the photographs in `images`
/// and their masks in `masks`.
pub const FILES: [&str; 5] =
    ["poses.json", "poses.log", "sparse/0/points3D.bin", "sparse/0/images.bin", "sparse/0/cameras.bin"];

/// The folder of unfinished work in that of the data set.
pub(crate) const WORK: &str = ".gs-poses";

/// Removes a folder of unfinished work.
pub(crate) fn remove(work: &Path) -> Result<(), Error> {
    match fs::remove_dir_all(work) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(Error::at(work)(error)),
        _ => Ok(()),
    }
}
