//! The tables and the report in a study's folder. One process at a time writes them; a folder's index
//! has their names, so that no other file is replaced.

use std::{
    ops::Deref,
    path::{Path, PathBuf},
    thread,
    time::{Duration, Instant},
};

use gs_io::{FolderClaim, OutputFolder};

use super::StudyFolder;
use crate::{
    error::Error,
    run::result_names::{PAGE, PLOTS, TABLES},
};

/// Longest time to wait for another process that prepares the folder or writes its report.
const PATIENCE: Duration = Duration::from_secs(120);

/// A claim to the files of tables and report.
pub(crate) fn results_claim(path: &Path) -> FolderClaim {
    let files = TABLES.into_iter().chain([PAGE]);
    FolderClaim { folders: vec![PLOTS.to_owned()], ..FolderClaim::new(path, files) }
}

/// A study's folder whose tables and report this process alone writes.
#[derive(Debug)]
pub(crate) struct LockedResults<'a> {
    pub(crate) folder: &'a StudyFolder,
    pub(crate) output: OutputFolder,
}

impl Deref for LockedResults<'_> {
    type Target = StudyFolder;

    fn deref(&self) -> &StudyFolder {
        self.folder
    }
}

impl LockedResults<'_> {
    /// Writes a text file into the folder.
    pub(crate) fn write(&self, name: &str, text: &str) -> Result<(), Error> {
        write(&self.output, name, text)
    }

    /// Claims files whose names depend on the results, before they are written.
    pub(crate) fn claim(&self, names: impl IntoIterator<Item = String>) -> Result<(), Error> {
        Ok(self.output.claim(names)?)
    }

    /// The path of a file that is about to be written; it is added to the folder's index.
    pub(crate) fn file_to_write(&self, name: &str) -> PathBuf {
        self.output.file(name)
    }
}

/// Begins to write into a folder. Waits while another process prepares it or writes its report.
pub(crate) fn begin(claim: FolderClaim) -> Result<OutputFolder, Error> {
    let patient_until = Instant::now() + PATIENCE;
    loop {
        match claim.clone().begin() {
            Err(gs_io::Error::Busy { .. }) if Instant::now() < patient_until => thread::sleep(PATIENCE / 1000),
            Err(gs_io::Error::Write { source, .. }) => {
                let what = format!("cannot be written to: {source}");
                let mend = "choose another folder with --output";
                return Err(Error::Folder { folder: claim.path, what, mend });
            }
            ended => return Ok(ended?),
        }
    }
}

pub(crate) fn write(output: &OutputFolder, name: &str, text: &str) -> Result<(), Error> {
    Ok(gs_io::write_atomically(output.file(name), |file| file.write_all(text.as_bytes()))?)
}
