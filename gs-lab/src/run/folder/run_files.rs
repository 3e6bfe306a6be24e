//! The files of a study's runs besides those of all jobs: what is in records, and pictures.

use gs_jobs::{
    JobStore,
    files::{ADDRESS_DIGITS, JobFile, RUNS},
};
use rayon::prelude::*;

use crate::{
    error::Error,
    run::record::{Record, RunOutcome},
    study::digest,
};

// A run's address is a digest.
const _: () = assert!(ADDRESS_DIGITS == digest::DIGITS);

/// The folder of pictures.
pub(crate) const PICTURES: &str = "pictures";

/// The end of the record of a run that finished: the closing brackets of its trajectory, its
/// numbers, its outcome and itself. Only speed depends on it.
const END_OF_FINISHED: &[u8] = b"]}}";

/// The name of a picture of a run, counted from 0.
pub(crate) fn picture(address: &str, index: usize) -> String {
    let number = if index == 0 { String::new() } else { format!("-{}", index + 1) };
    format!("{PICTURES}/{address}{number}.png")
}

/// Removes the records of runs that failed, and those that were cut short, so that the runs are done
/// again.
///
/// # Errors
/// [`Error::Jobs`] where the folder cannot be read or a file cannot be removed.
pub(crate) fn remove_unfinished(store: &JobStore) -> Result<(), Error> {
    let names = store.names(RUNS)?;
    let records = names.par_iter().filter(|name| matches!(JobFile::of(name), Some(JobFile::Record(_))));
    records.map(|name| format!("{RUNS}/{name}")).try_for_each(|name| match is_finished(store, &name)? {
        true => Ok(()),
        false => Ok(store.remove(&name)?),
    })
}

/// Whether a file is the record of a run that finished. One that has just been removed counts as one.
fn is_finished(store: &JobStore, name: &str) -> Result<bool, Error> {
    if store.end(name, END_OF_FINISHED.len())?.is_none_or(|end| end == END_OF_FINISHED) {
        return Ok(true);
    }
    let record = |whole: Vec<u8>| serde_json::from_slice::<Record>(&whole);
    let is_finished = |record: Record| matches!(record.outcome, RunOutcome::Finished(_));
    Ok(store.read(name)?.is_none_or(|whole| record(whole).is_ok_and(is_finished)))
}
