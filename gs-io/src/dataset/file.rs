//! Reads the files of data sets.

use std::{io::Read, path::Path};

use crate::{atomic::open, error::Error};

/// Reads a file of a data set.
pub(super) fn read_file(path: &Path) -> Result<Vec<u8>, Error> {
    let mut bytes = Vec::new();
    let read = open(path, "a file of a data set")?.0.read_to_end(&mut bytes);
    read.map(|_| bytes).map_err(|source| Error::read(path, source))
}
