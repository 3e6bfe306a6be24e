//! The files of a study's runs: records, and of runs that have no record yet claims and checkpoints.

use std::collections::{HashMap, HashSet};

use rayon::prelude::*;

use crate::{
    claims::Claims,
    digest::DIGITS,
    error::Error,
    record::{Record, RunOutcome},
    run_store::RunStore,
};

/// The folder of records, claims and checkpoints.
pub(crate) const RUNS: &str = "runs";
/// The folder of pictures.
pub(crate) const PICTURES: &str = "pictures";

/// The end of the record of a run that finished: the closing brackets of its trajectory, its
/// numbers, its outcome and itself. Only speed depends on it.
const END_OF_FINISHED: &[u8] = b"]}}";

/// The name of a run's record.
pub(crate) fn record(address: &str) -> String {
    format!("{RUNS}/{address}.json")
}

/// The name of a claim on a run.
pub(crate) fn claim(address: &str, generation: u32) -> String {
    format!("{RUNS}/{address}.{generation}.claim")
}

/// The name of a run's checkpoint.
pub(crate) fn checkpoint(address: &str) -> String {
    format!("{RUNS}/{address}.safetensors")
}

/// The name of a picture of a run, counted from 0.
pub(crate) fn picture(address: &str, index: usize) -> String {
    let number = if index == 0 { String::new() } else { format!("-{}", index + 1) };
    format!("{PICTURES}/{address}{number}.png")
}

/// A file in the folder of a study's runs.
#[derive(Debug, Clone, PartialEq, Eq)]
enum RunFile<'a> {
    /// The record of the run with this address.
    Record(&'a str),
    /// A claim on the run with this address, and the claim's number.
    Claim(&'a str, u32),
    /// The checkpoint of the run with this address.
    Checkpoint(&'a str),
    /// A file under a name that processes give to files they are about to rename or remove.
    Temporary,
}

impl<'a> RunFile<'a> {
    /// The file of this name; `None` for names that are not of a study.
    fn of(name: &'a str) -> Option<Self> {
        if name.ends_with(".now") || (name.starts_with(".gs-") && name.ends_with(".tmp")) {
            return Some(Self::Temporary);
        }
        let (address, rest) = name.split_at_checked(DIGITS)?;
        if !address.bytes().all(|byte| byte.is_ascii_hexdigit()) {
            return None;
        }
        match rest.strip_prefix('.')? {
            "json" => Some(Self::Record(address)),
            "safetensors" => Some(Self::Checkpoint(address)),
            rest => Some(Self::Claim(address, rest.strip_suffix(".claim")?.parse().ok()?)),
        }
    }
}

/// What the folder of a study's runs holds.
#[derive(Debug, Clone, Default)]
pub(crate) struct Listing {
    /// Addresses of the runs that have a record.
    pub(crate) ended: HashSet<String>,
    /// The last claim on each run that has claims, by the run's address.
    pub(crate) claimed: HashMap<String, u32>,
}

impl Listing {
    /// Lists the folder.
    ///
    /// # Errors
    /// [`Error::Path`] or [`Error::Store`] where it cannot be read.
    pub(crate) fn of(store: &dyn RunStore) -> Result<Self, Error> {
        let mut listing = Self::default();
        for name in store.names(RUNS)? {
            match RunFile::of(&name) {
                Some(RunFile::Record(address)) => {
                    listing.ended.insert(address.to_owned());
                }
                Some(RunFile::Claim(address, generation)) => {
                    let last = listing.claimed.entry(address.to_owned()).or_default();
                    *last = generation.max(*last);
                }
                Some(RunFile::Checkpoint(_) | RunFile::Temporary) | None => {}
            }
        }
        Ok(listing)
    }
}

/// Removes what processes that died have left: claims on runs that have a record, their checkpoints,
/// and temporary files that are older than a lease.
///
/// # Errors
/// [`Error::Path`] or [`Error::Store`] where the folder cannot be read, [`Error::Io`] where it cannot
/// be written to.
pub(crate) fn sweep(store: &dyn RunStore, claims: &Claims) -> Result<(), Error> {
    let names = store.names(RUNS)?;
    let files = || names.iter().filter_map(|name| Some((name, RunFile::of(name)?)));
    let ended: HashSet<&str> = files()
        .filter_map(|(_, file)| match file {
            RunFile::Record(address) => Some(address),
            _ => None,
        })
        .collect();
    for (name, file) in files() {
        let name = format!("{RUNS}/{name}");
        let is_left = match file {
            RunFile::Claim(address, _) | RunFile::Checkpoint(address) => ended.contains(address),
            RunFile::Temporary => claims.is_old(&name)?,
            RunFile::Record(_) => false,
        };
        if is_left {
            // It does no harm where it cannot be removed.
            let _ = store.remove(&name);
        }
    }
    Ok(())
}

/// Removes the records of runs that failed, and those that were cut short, so that the runs are done
/// again.
///
/// # Errors
/// [`Error::Path`] or [`Error::Store`] where the folder cannot be read or a file cannot be removed.
pub(crate) fn remove_unfinished(store: &dyn RunStore) -> Result<(), Error> {
    let names = store.names(RUNS)?;
    let records = names.par_iter().filter(|name| matches!(RunFile::of(name), Some(RunFile::Record(_))));
    records.map(|name| format!("{RUNS}/{name}")).try_for_each(|name| match is_finished(store, &name)? {
        true => Ok(()),
        false => store.remove(&name),
    })
}

/// Whether a file is the record of a run that finished. One that has just been removed counts as one.
fn is_finished(store: &dyn RunStore, name: &str) -> Result<bool, Error> {
    if store.end(name, END_OF_FINISHED.len())?.is_none_or(|end| end == END_OF_FINISHED) {
        return Ok(true);
    }
    let record = |whole: Vec<u8>| serde_json::from_slice::<Record>(&whole);
    let is_finished = |record: Record| matches!(record.outcome, RunOutcome::Finished(_));
    Ok(store.read(name)?.is_none_or(|whole| record(whole).is_ok_and(is_finished)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_of_records_claims_checkpoints_and_temporary_files() {
        let address = "0123456789abcdef0123456789abcdef";
        let of = |name: String| RunFile::of(name.trim_start_matches("runs/")).map(|file| format!("{file:?}"));
        assert_eq!(of(record(address)), Some(format!("Record({address:?})")));
        assert_eq!(of(claim(address, 12)), Some(format!("Claim({address:?}, 12)")));
        assert_eq!(of(checkpoint(address)), Some(format!("Checkpoint({address:?})")));
        for name in [".gs-Ab12Cd.tmp", "0123456789abcdef.now"] {
            assert_eq!(of(name.to_owned()).as_deref(), Some("Temporary"));
        }
        for other in ["notes.json", &address[1..], &format!("{address}.x.claim"), &format!("g{address}.json"), "é"] {
            assert_eq!(of((*other).to_owned()), None, "{other}");
        }
    }
}
