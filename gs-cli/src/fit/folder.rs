//! The folder that a fit writes its results into.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use crate::failure::Failure;

/// A folder that is known to take files.
#[derive(Debug)]
pub(crate) struct OutputFolder(PathBuf);

impl OutputFolder {
    /// Makes the folder if it is not there, and finds out whether it can be written to, before any work is spent on what would
    /// be written; `flag` is the one that names another.
    ///
    /// # Errors
    /// Where it cannot be made, is no folder, or takes no files.
    pub(crate) fn prepare(path: &Path, flag: &str) -> Result<Self, Failure> {
        let failed = |source: io::Error| {
            Failure::failed(format_args!("{}: cannot be written to: {source}", path.display()))
                .mend(format_args!("choose another folder with {flag}"))
        };
        fs::create_dir_all(path).map_err(failed)?;
        let trial = path.join(format!(".gs-trial-{}", std::process::id()));
        fs::write(&trial, []).and_then(|()| fs::remove_file(&trial)).map_err(failed)?;
        Ok(Self(path.to_owned()))
    }

    /// A file in it.
    pub(crate) fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// Its path.
    pub(crate) fn path(&self) -> &Path {
        &self.0
    }
}
