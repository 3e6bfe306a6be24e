//! Claims on jobs that any number of processes share, on any number of machines.
//!
//! A claim is a file next to the job's record, `ADDRESS.0.claim`, that only one process can create.
//! The process that created it computes the job, stores the record and removes the claim. While it
//! computes, it rewrites the claim every sixth of the *lease*. A claim that is older than its lease
//! belongs to a dead process, and whoever first creates `ADDRESS.1.claim` takes the job over.
//!
//! Three rules keep this correct without locks between machines:
//!
//! - **Claims are only added** while a job has no record: a process that gives a job up marks its
//!   claim as released, and the next claim has the next number. Each number is created once, so two
//!   processes never take over the same claim.
//! - **The record is looked for again after the claim was created,** because the job may have ended
//!   in between. Records and claims lie in one folder, so that creating the claim renews what an
//!   NFS client knows of the folder.
//! - **Ages are differences of times that the file server has set:** that of the claim and that of a
//!   file made for the comparison. The clocks of the machines do not matter.
//!
//! A process also locks its claims. Where another process of the same running system gets the lock,
//! the owner is dead, and the job need not wait for the end of the lease.

use std::{
    collections::HashSet,
    fmt,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant, SystemTime},
};

use serde::{Deserialize, Serialize};

use super::{
    files::{self, JobFile, Listing, RUNS},
    store::{JobStore, Locked, OwnFile},
    system,
};
use crate::error::Error;

/// Heartbeats per lease. Several may fail before the claim expires.
pub(crate) const BEATS: u32 = 6;

/// Time for which the store's clock is not read again.
const CLOCK: Duration = Duration::from_secs(1);

/// First word of a claim's file. Both words have the same length, so that one small write replaces
/// one by the other.
const WORKING: &[u8] = b"working \n";
const RELEASED: &[u8] = b"released\n";

/// What a claim says about itself, for other processes and for people.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct ClaimNote {
    /// The process that computes, in words: its machine, its number and its job.
    pub(crate) worker: String,
    /// The job, in words.
    pub(crate) job: String,
    /// Time after which the claim expires unless it is rewritten, s.
    pub(crate) lease: f64,
    /// The running system and its file system. Where it is that of the reader, locks on the claim
    /// can be trusted.
    system: String,
    /// Whether the owner holds a lock on the claim.
    locked: bool,
    /// A word that no other claim has.
    #[serde(default)]
    token: String,
}

/// A process that has claimed a job. It is displayed in words.
#[derive(Debug, Clone, PartialEq)]
pub struct Holder {
    /// The process; `None` where its claim cannot be read.
    pub worker: Option<String>,
    /// Time since its last sign of life, by the file server's clock; `None` if it is dead.
    pub age: Option<Duration>,
}

impl fmt::Display for Holder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.worker.as_deref().unwrap_or("a process that has just begun"))?;
        match self.age {
            Some(age) => write!(f, ": last sign of life {:.0} s ago", age.as_secs_f64()),
            None => f.write_str(": died"),
        }
    }
}

/// The claims in a store, made by one process.
#[derive(Debug)]
pub struct Claims {
    store: JobStore,
    worker: String,
    lease: Duration,
    system: String,
    /// The claims that this process holds.
    held: Mutex<Vec<Arc<OwnClaim>>>,
    /// The time of the store, and when it was read.
    clock: Mutex<Option<(Instant, SystemTime)>>,
}

/// The file of a claim of this process.
#[derive(Debug)]
struct OwnClaim {
    file: OwnFile,
    /// What follows the first word.
    note: Vec<u8>,
}

impl OwnClaim {
    /// Writes the claim with another first word, which also renews its time. A claim that cannot be
    /// written is left to its lease.
    fn mark(&self, word: &[u8]) {
        let _ = self.file.rewrite(&[word, &self.note].concat());
    }
}

/// An attempt to claim a job.
#[derive(Debug)]
pub(crate) enum Attempt<'a> {
    /// The job belongs to the caller.
    Claimed(Claim<'a>),
    /// The job has a record.
    Ended,
    /// Another process computes the job.
    Taken,
}

/// The state of a claim.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum State {
    /// Its owner computes. The age is the time since its last sign of life.
    Live {
        /// What the claim says; `None` before its owner has written it.
        note: Option<ClaimNote>,
        /// Time since the last sign of life, by the store's clock.
        age: Duration,
    },
    /// Its owner has given the job up.
    Released,
    /// Its owner is dead.
    Expired {
        /// What the claim says; `None` where its owner died before writing it.
        note: Option<ClaimNote>,
    },
    /// It has been removed, because the job has ended.
    Gone,
}

impl Claims {
    /// Claims in a store. `worker` names this process in its claims.
    pub fn new(store: JobStore, worker: String, lease: Duration) -> Self {
        let system = store.system();
        Self { store, worker, lease, system, held: Mutex::default(), clock: Mutex::default() }
    }

    /// Tries to claim a job. `job` describes it for people.
    ///
    /// # Errors
    /// [`Error::Write`] where the claim cannot be written.
    pub(crate) fn attempt(&self, address: &str, job: &str) -> Result<Attempt<'_>, Error> {
        if self.has_record(address) {
            return Ok(Attempt::Ended);
        }
        let token = system::token();
        let note = |locked| self.note(job, locked, &token);
        let mut generation = 0;
        let file = loop {
            let name = files::claim(address, generation);
            if let Some(file) = self.store.create(&name, |locked| [WORKING, &note(locked)].concat())? {
                break file;
            }
            match self.state(&name)? {
                State::Live { .. } => return Ok(Attempt::Taken),
                State::Released | State::Expired { .. } => generation += 1,
                State::Gone => return Ok(if self.has_record(address) { Attempt::Ended } else { Attempt::Taken }),
            }
        };
        let own = Arc::new(OwnClaim { note: note(file.locked()), file });
        self.held().push(own.clone());
        let claim = Claim { claims: self, address: address.to_owned(), generation, own: Some(own) };
        if self.has_record(address) {
            claim.finish();
            return Ok(Attempt::Ended);
        }
        Ok(Attempt::Claimed(claim))
    }

    /// Shows that this process is alive, in all claims that it holds.
    pub(crate) fn beat(&self) {
        self.held().iter().for_each(|own| own.mark(WORKING));
    }

    /// Time between two heartbeats.
    pub(crate) fn interval(&self) -> Duration {
        self.lease / BEATS
    }

    /// The state of a claim.
    ///
    /// # Errors
    /// [`Error::Write`] where the store's time cannot be read.
    pub(crate) fn state(&self, name: &str) -> Result<State, Error> {
        let Some(seen) = self.store.look(name) else { return Ok(State::Gone) };
        if seen.content.starts_with(RELEASED) {
            return Ok(State::Released);
        }
        // A claim without a complete note has just been created, or its owner died then.
        let note = seen.content.strip_prefix(WORKING).and_then(|note| serde_json::from_slice(note).ok());
        let note: Option<ClaimNote> = note;
        let is_here = note.as_ref().is_some_and(|note| note.locked && note.system == self.system);
        if is_here && seen.is_free() {
            return Ok(State::Expired { note });
        }
        let lease = note.as_ref().and_then(|note| Duration::try_from_secs_f64(note.lease).ok()).unwrap_or(self.lease);
        let Some(written) = seen.written else { return Ok(State::Live { note, age: Duration::ZERO }) };
        let age = self.now()?.duration_since(written).unwrap_or_default();
        Ok(if age > lease { State::Expired { note } } else { State::Live { note, age } })
    }

    /// Who is doing each of these jobs; `None` for jobs that have ended, that were given up, and that nobody has claimed.
    ///
    /// # Errors
    /// [`Error::Path`] where the folder cannot be read, [`Error::Write`] where the store's time cannot be read.
    pub fn holders<'j>(&self, addresses: impl IntoIterator<Item = &'j str>) -> Result<Vec<Option<Holder>>, Error> {
        let listing = Listing::of(&self.store)?;
        let holder = |address: &str| {
            let claimed = listing.claimed.get(address).filter(|_| !listing.ended.contains(address));
            let Some(generation) = claimed else { return Ok(None) };
            let (note, age) = match self.state(&files::claim(address, *generation))? {
                State::Live { note, age } => (note, Some(age)),
                State::Expired { note } => (note, None),
                State::Released | State::Gone => return Ok(None),
            };
            Ok(Some(Holder { worker: note.map(|note| note.worker), age }))
        };
        addresses.into_iter().map(holder).collect()
    }

    /// Whether a file was last written longer ago than a lease, by the store's clock.
    ///
    /// # Errors
    /// [`Error::Write`] where the store's time cannot be read.
    pub(crate) fn is_old(&self, name: &str) -> Result<bool, Error> {
        let Some(written) = self.store.look(name).and_then(|seen| seen.written) else { return Ok(false) };
        Ok(self.now()?.duration_since(written).is_ok_and(|age| age > self.lease))
    }

    /// Removes what processes that died have left: claims on jobs that have a record, their
    /// checkpoints, and temporary files that are older than a lease.
    ///
    /// # Errors
    /// [`Error::Path`] where the folder cannot be read, [`Error::Write`] where it
    /// cannot be written to.
    pub fn sweep(&self) -> Result<(), Error> {
        let names = self.store.names(RUNS)?;
        let files = || names.iter().filter_map(|name| Some((name, JobFile::of(name)?)));
        let ended: HashSet<&str> = files()
            .filter_map(|(_, file)| match file {
                JobFile::Record(address) => Some(address),
                _ => None,
            })
            .collect();
        for (name, file) in files() {
            let name = format!("{RUNS}/{name}");
            let is_left = match file {
                JobFile::Claim(address, _) | JobFile::Checkpoint(address) => ended.contains(address),
                JobFile::Temporary => self.is_old(&name)?,
                JobFile::Record(_) => false,
            };
            if is_left {
                let _ = self.store.remove(&name);
            }
        }
        Ok(())
    }

    /// The time of the store, at most [`CLOCK`] old. A time that is too early makes claims seem
    /// younger, so none expires too soon.
    fn now(&self) -> Result<SystemTime, Error> {
        let mut clock = self.clock.lock().unwrap_or_else(PoisonError::into_inner);
        match *clock {
            Some((read, time)) if read.elapsed() < CLOCK => Ok(time),
            _ => {
                let time = self.store.now(RUNS)?;
                *clock = Some((Instant::now(), time));
                Ok(time)
            }
        }
    }

    /// Who holds a claim, and for how long, as it is written.
    fn note(&self, job: &str, locked: Locked, token: &str) -> Vec<u8> {
        let note = ClaimNote {
            worker: self.worker.clone(),
            job: job.to_owned(),
            lease: self.lease.as_secs_f64(),
            system: self.system.clone(),
            locked: locked == Locked::Yes,
            token: token.to_owned(),
        };
        serde_json::to_vec(&note).unwrap_or_default()
    }

    fn has_record(&self, address: &str) -> bool {
        self.store.has(&files::record(address))
    }

    fn held(&self) -> MutexGuard<'_, Vec<Arc<OwnClaim>>> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A job that belongs to this process. When dropped, the job is free for others.
#[derive(Debug)]
pub struct Claim<'a> {
    claims: &'a Claims,
    address: String,
    generation: u32,
    /// `None` once the claim is finished.
    own: Option<Arc<OwnClaim>>,
}

impl Claim<'_> {
    /// Removes the claim, and those that it took over. The job must have a record.
    pub fn finish(mut self) {
        // Closed first: an NFS client renames a file that is removed while it is open.
        self.close();
        for generation in 0..=self.generation {
            // Claims of jobs that have ended mean nothing; the next report removes what is left.
            let _ = self.claims.store.remove(&files::claim(&self.address, generation));
        }
    }

    /// Ends the heartbeats and returns the file.
    fn close(&mut self) -> Option<Arc<OwnClaim>> {
        let own = self.own.take()?;
        self.claims.held().retain(|held| !Arc::ptr_eq(held, &own));
        Some(own)
    }
}

impl Drop for Claim<'_> {
    fn drop(&mut self) {
        if let Some(own) = self.close() {
            own.mark(RELEASED);
        }
    }
}

#[cfg(test)]
mod tests;
