//! The files of jobs: records of those that have ended, and of others claims and checkpoints.

use std::collections::{HashMap, HashSet};

use super::store::JobStore;
use crate::error::Error;

/// The folder of records, claims and checkpoints.
pub const RUNS: &str = "runs";

/// Hexadecimal digits of a job's address.
pub const ADDRESS_DIGITS: usize = 32;

/// The name of a job's record.
pub fn record(address: &str) -> String {
    format!("{RUNS}/{address}.json")
}

/// The name of a claim on a job.
pub fn claim(address: &str, generation: u32) -> String {
    format!("{RUNS}/{address}.{generation}.claim")
}

/// The name of a job's checkpoint.
pub fn checkpoint(address: &str) -> String {
    format!("{RUNS}/{address}.safetensors")
}

/// A file in the folder of the jobs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum JobFile<'a> {
    /// The record of the job with this address.
    Record(&'a str),
    /// A claim on the job with this address, and the claim's number.
    Claim(&'a str, u32),
    /// The checkpoint of the job with this address.
    Checkpoint(&'a str),
    /// A file under a name that processes give to files they are about to rename or remove.
    Temporary,
}

impl<'a> JobFile<'a> {
    /// The file of this name; `None` for names that are not of jobs.
    pub fn of(name: &'a str) -> Option<Self> {
        if name.ends_with(".now") || (name.starts_with(".gs-") && name.ends_with(".tmp")) {
            return Some(Self::Temporary);
        }
        let (address, rest) = name.split_at_checked(ADDRESS_DIGITS)?;
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

/// What the folder of the jobs holds.
#[derive(Debug, Clone, Default)]
pub struct Listing {
    /// Addresses of the jobs that have a record.
    pub ended: HashSet<String>,
    /// The last claim on each job that has claims, by the job's address.
    pub claimed: HashMap<String, u32>,
}

impl Listing {
    /// Lists the folder.
    ///
    /// # Errors
    /// [`Error::Path`] where it cannot be read.
    pub fn of(store: &JobStore) -> Result<Self, Error> {
        let mut listing = Self::default();
        for name in store.names(RUNS)? {
            match JobFile::of(&name) {
                Some(JobFile::Record(address)) => {
                    listing.ended.insert(address.to_owned());
                }
                Some(JobFile::Claim(address, generation)) => {
                    let last = listing.claimed.entry(address.to_owned()).or_default();
                    *last = generation.max(*last);
                }
                Some(JobFile::Checkpoint(_) | JobFile::Temporary) | None => {}
            }
        }
        Ok(listing)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_of_records_claims_checkpoints_and_temporary_files() {
        let address = "0123456789abcdef0123456789abcdef";
        let of = |name: String| JobFile::of(name.trim_start_matches("runs/")).map(|file| format!("{file:?}"));
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
