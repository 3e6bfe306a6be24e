//! Errors of shared jobs.

use std::{io, path::PathBuf};

use thiserror::Error;

/// An error of shared jobs.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Error {
    /// A folder or a file cannot be read.
    #[error("{}: {source}", path.display())]
    Path {
        /// The path.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// A file cannot be written.
    #[error("{}: cannot be written: {source}", path.display())]
    Write {
        /// The path.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// A setting of [`WorkSettings`](crate::WorkSettings) is out of its range.
    #[error("{message}")]
    Work {
        /// The setting, and its range.
        message: String,
    },
}
