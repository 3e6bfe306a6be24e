//! The files of a study's runs: records, and claims on runs that have no record yet.

use std::{
    collections::{HashMap, HashSet},
    ffi::OsStr,
    fs::{self, DirEntry, File},
    io::{self, ErrorKind, Read, Seek, SeekFrom},
    path::Path,
};

use rayon::prelude::*;

use crate::{
    claims::Claims,
    digest::DIGITS,
    error::Error,
    record::{Record, RunOutcome},
};

/// The end of the record of a run that finished: the closing brackets of its trajectory, its
/// numbers, its outcome and itself. Only speed depends on it.
const END_OF_FINISHED: &[u8] = b"]}}";

/// The file name of a run's record.
pub(crate) fn record(address: &str) -> String {
    format!("{address}.json")
}

/// The file name of a claim on a run.
pub(crate) fn claim(address: &str, generation: u32) -> String {
    format!("{address}.{generation}.claim")
}

/// A file in the folder of a study's runs.
#[derive(Debug, Clone, PartialEq, Eq)]
enum RunFile<'a> {
    /// The record of the run with this address.
    Record(&'a str),
    /// A claim on the run with this address, and the claim's number.
    Claim(&'a str, u32),
    /// A file under a name that processes give to files they are about to rename or remove.
    Temporary,
}

impl<'a> RunFile<'a> {
    /// The file of this name; `None` for names that are not of a study.
    fn of(name: &'a OsStr) -> Option<Self> {
        let name = name.to_str()?;
        if name.ends_with(".now") || (name.starts_with(".gs-") && name.ends_with(".tmp")) {
            return Some(Self::Temporary);
        }
        let (address, rest) = name.split_at_checked(DIGITS)?;
        if !address.bytes().all(|byte| byte.is_ascii_hexdigit()) {
            return None;
        }
        match rest.strip_prefix('.')? {
            "json" => Some(Self::Record(address)),
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
    /// [`Error::Path`] where the folder cannot be read.
    pub(crate) fn of(folder: &Path) -> Result<Self, Error> {
        let mut listing = Self::default();
        for entry in entries(folder)? {
            match RunFile::of(&entry.file_name()) {
                Some(RunFile::Record(address)) => {
                    listing.ended.insert(address.to_owned());
                }
                Some(RunFile::Claim(address, generation)) => {
                    let last = listing.claimed.entry(address.to_owned()).or_default();
                    *last = generation.max(*last);
                }
                Some(RunFile::Temporary) | None => {}
            }
        }
        Ok(listing)
    }
}

fn entries(folder: &Path) -> Result<Vec<DirEntry>, Error> {
    let entries = fs::read_dir(folder).and_then(Iterator::collect);
    entries.map_err(|source| Error::Path { path: folder.to_owned(), source })
}

/// Removes what processes that died have left: claims on runs that have a record, and temporary
/// files that are older than a lease.
///
/// # Errors
/// [`Error::Path`] where the folder cannot be read, [`Error::Io`] where it cannot be written to.
pub(crate) fn sweep(folder: &Path, claims: &Claims) -> Result<(), Error> {
    let ended = Listing::of(folder)?.ended;
    for entry in entries(folder)? {
        let is_left = match RunFile::of(&entry.file_name()) {
            Some(RunFile::Claim(address, _)) => ended.contains(address),
            Some(RunFile::Temporary) => claims.is_old(&entry.path())?,
            Some(RunFile::Record(_)) | None => false,
        };
        if is_left {
            // It does no harm where it cannot be removed.
            let _ = fs::remove_file(entry.path());
        }
    }
    Ok(())
}

/// Removes the records of runs that failed, and those that were cut short, so that the runs are done
/// again.
///
/// # Errors
/// [`Error::Path`] where the folder cannot be read or a file cannot be removed.
pub(crate) fn remove_unfinished(folder: &Path) -> Result<(), Error> {
    let records = entries(folder)?;
    records.par_iter().filter(|entry| matches!(RunFile::of(&entry.file_name()), Some(RunFile::Record(_)))).try_for_each(
        |entry| {
            let path = entry.path();
            match is_finished(&path) {
                true => Ok(()),
                false => fs::remove_file(&path).map_err(|source| Error::Path { path, source }),
            }
        },
    )
}

/// Whether a file is the record of a run that finished. A file that cannot be read counts as one.
fn is_finished(path: &Path) -> bool {
    let end_or_whole = || -> io::Result<Option<Vec<u8>>> {
        let mut file = File::open(path)?;
        let mut end = [0; END_OF_FINISHED.len()];
        let length = file.metadata()?.len();
        if length >= end.len() as u64 {
            file.seek(SeekFrom::Start(length - end.len() as u64))?;
            file.read_exact(&mut end)?;
            if end == END_OF_FINISHED {
                return Ok(None);
            }
            file.rewind()?;
        }
        let mut whole = Vec::new();
        file.read_to_end(&mut whole)?;
        Ok(Some(whole))
    };
    match end_or_whole() {
        Ok(Some(whole)) => serde_json::from_slice::<Record>(&whole)
            .is_ok_and(|record| matches!(record.outcome, RunOutcome::Finished(_))),
        Ok(None) => true,
        Err(error) => error.kind() != ErrorKind::UnexpectedEof,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_of_records_claims_and_temporary_files() {
        let address = "0123456789abcdef0123456789abcdef";
        let of = |name: String| RunFile::of(OsStr::new(&name)).map(|file| format!("{file:?}"));
        assert_eq!(of(record(address)), Some(format!("Record({address:?})")));
        assert_eq!(of(claim(address, 12)), Some(format!("Claim({address:?}, 12)")));
        for name in [".gs-Ab12Cd.tmp", "0123456789abcdef.now"] {
            assert_eq!(of(name.to_owned()).as_deref(), Some("Temporary"));
        }
        for other in ["notes.json", &address[1..], &format!("{address}.x.claim"), &format!("g{address}.json"), "é"] {
            assert_eq!(of((*other).to_owned()), None, "{other}");
        }
    }
}
