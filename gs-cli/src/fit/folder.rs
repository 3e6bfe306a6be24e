//! The folder that a command writes its results into.

use std::{
    env, fs, io,
    path::{Path, PathBuf},
    process,
};

use gs_io::write_atomically;
use serde::Serialize;

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
        let trial = path.join(format!(".gs-trial-{}", process::id()));
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

    /// Writes a file of text.
    ///
    /// # Errors
    /// Where it cannot be written.
    pub(crate) fn write_text(&self, name: &str, text: &str) -> Result<(), Failure> {
        Ok(write_atomically(self.file(name), |file| file.write_all(text.as_bytes()))?)
    }

    /// Writes what cannot be made again without doing all the work again. Where the folder does not take it, as on a full disk, it goes into
    /// the system's folder for temporary files.
    ///
    /// # Errors
    /// Where it cannot be written into this folder, even if it could be saved elsewhere; then the failure says where it is.
    pub(crate) fn write_precious(
        &self,
        name: &str,
        write: impl Fn(&Path) -> Result<(), gs_io::Error>,
    ) -> Result<(), Failure> {
        let Err(error) = write(&self.file(name)) else { return Ok(()) };
        let elsewhere = env::temp_dir().join(format!("gs-{}-{name}", process::id()));
        Err(match write(&elsewhere) {
            Ok(()) => Failure::from(error).mend(format_args!("it has been saved as {} instead", elsewhere.display())),
            Err(_) => error.into(),
        })
    }

    /// Writes a value as JSON.
    ///
    /// # Errors
    /// Where it has no such form, or cannot be written.
    pub(crate) fn write_json(&self, name: &str, value: &impl Serialize) -> Result<(), Failure> {
        let json = serde_json::to_string_pretty(value).map_err(|error| Failure::failed(error).at(name))?;
        self.write_text(name, &(json + "\n"))
    }

    /// Removes a file that this run does not write: one of an earlier run would be taken for its.
    ///
    /// # Errors
    /// Where it is there and cannot be removed.
    pub(crate) fn leave_out(&self, name: &str) -> Result<(), Failure> {
        let path = self.file(name);
        match fs::remove_file(&path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                let what = format_args!("{}: is of an earlier run and cannot be removed: {error}", path.display());
                Err(Failure::failed(what).mend("choose another folder with --output"))
            }
            _ => Ok(()),
        }
    }
}
