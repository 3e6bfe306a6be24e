//! The folder of unfinished work.

use std::{fs, path::Path};

use crate::error::Error;

/// The folder of unfinished work in that of the data set.
pub(crate) const WORK: &str = ".gs-poses";

/// Removes a folder of unfinished work.
pub(crate) fn remove(work: &Path) -> Result<(), Error> {
    match fs::remove_dir_all(work) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(Error::at(work)(error)),
        _ => Ok(()),
    }
}
