//! The tables and the report in a study's folder. One process at a time writes them; a folder's index
//! has their names, so that no other file is replaced.

use std::{
    path::Path,
    thread,
    time::{Duration, Instant},
};

use gs_io::{FolderClaim, OutputFolder};

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

/// Begins to write into a folder. Waits while another process prepares it or writes its report.
pub(crate) fn begin(claim: FolderClaim) -> Result<OutputFolder, Error> {
    let patient_until = Instant::now() + PATIENCE;
    loop {
        match claim.clone().begin() {
            Err(gs_io::Error::Busy { .. }) if Instant::now() < patient_until => thread::sleep(PATIENCE / 1000),
            Err(gs_io::Error::Write { source, .. }) => {
                let what = format!("cannot be written to: {source}");
                let hint = "choose another folder with --output";
                return Err(Error::Folder { folder: claim.path, what, hint });
            }
            ended => return Ok(ended?),
        }
    }
}
