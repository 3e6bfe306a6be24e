//! Claims on the runs of a folder that any number of processes share, on any number of machines.
//!
//! A claim is a file beside the run's record, `ADDRESS.0.claim`, that only one process can create.
//! The process that created it computes the run, stores the record and removes the claim. While it
//! computes, it rewrites the claim every sixth of the *lease*. A claim that is older than its lease
//! belongs to a dead process, and whoever first creates `ADDRESS.1.claim` takes the run over.
//!
//! Three rules keep this correct without locks between machines:
//!
//! - **Claims are only added** while a run has no record: a process that gives a run up marks its
//!   claim as released, and the next claim has the next number. Each number is created once, so two
//!   processes never take over the same claim.
//! - **The record is looked for again after the claim was created,** because the run may have ended
//!   in between. Records and claims lie in one folder, so that creating the claim renews what an
//!   NFS client knows of the folder.
//! - **Ages are differences of times that the file server has set:** that of the claim and that of
//!   a file made for the comparison. The clocks of the machines do not matter.
//!
//! A process also locks its claims. Where another process of the same running system gets the lock,
//! the owner is dead, and the run need not wait for the end of the lease.

use std::{
    fs::{self, File},
    io::{self, ErrorKind, Read, Seek, SeekFrom, Write},
    path::{Path, PathBuf},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant, SystemTime},
};

use serde::{Deserialize, Serialize};

use crate::{error::Error, run_files, system};

/// Heartbeats per lease. Several may fail before the claim expires.
pub(crate) const BEATS: u32 = 6;

/// Time for which the file server's clock is not read again.
const CLOCK: Duration = Duration::from_secs(1);

/// Longest claim that is read, bytes.
const MOST_BYTES: u64 = 4096;

/// First word of a claim's file. Both words have the same length, so that one small write replaces
/// one by the other.
const WORKING: &[u8] = b"working \n";
const RELEASED: &[u8] = b"released\n";

/// What a claim says about itself, for other processes and for people.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct ClaimNote {
    /// The process that computes, in words: its machine, its number and its job.
    pub worker: String,
    /// The run, in words.
    pub run: String,
    /// Time after which the claim expires unless it is rewritten, s.
    pub lease: f64,
    /// The running system and its file system. Where it is that of the reader, locks on the claim
    /// can be trusted.
    system: String,
    /// Whether the owner holds a lock on the claim.
    locked: bool,
}

/// The claims in a folder, made by one process.
#[derive(Debug)]
pub(crate) struct Claims {
    folder: PathBuf,
    worker: String,
    lease: Duration,
    system: String,
    /// The claims that this process holds.
    held: Mutex<Vec<Arc<File>>>,
    /// The time of the file server, and when it was read.
    clock: Mutex<Option<(Instant, SystemTime)>>,
}

/// An attempt to claim a run.
#[derive(Debug)]
pub(crate) enum Attempt<'a> {
    /// The run belongs to the caller.
    Claimed(Claim<'a>),
    /// The run has a record.
    Ended,
    /// Another process computes the run.
    Taken,
}

/// The state of a claim.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum State {
    /// Its owner computes. The age is that of its last sign of life.
    Live { note: Option<ClaimNote>, age: Duration },
    /// Its owner has given the run up.
    Released,
    /// Its owner is dead.
    Expired { note: Option<ClaimNote> },
    /// It has been removed, because the run has ended.
    Gone,
}

impl Claims {
    /// Claims in a folder that exists. `worker` names this process in its claims.
    pub(crate) fn new(folder: PathBuf, worker: String, lease: Duration) -> Self {
        let system = system::identity(&folder);
        Self { folder, worker, lease, system, held: Mutex::default(), clock: Mutex::default() }
    }

    /// Tries to claim a run. `run` describes it for people.
    ///
    /// # Errors
    /// [`Error::Io`] where the claim cannot be written.
    pub(crate) fn attempt(&self, address: &str, run: &str) -> Result<Attempt<'_>, Error> {
        if self.has_record(address) {
            return Ok(Attempt::Ended);
        }
        let mut generation = 0;
        let file = loop {
            let path = self.path(address, generation);
            match File::options().read(true).write(true).create_new(true).open(&path) {
                Ok(file) => break file,
                Err(error) if error.kind() == ErrorKind::AlreadyExists => match self.state(&path)? {
                    State::Live { .. } => return Ok(Attempt::Taken),
                    State::Released | State::Expired { .. } => generation += 1,
                    State::Gone => return Ok(if self.has_record(address) { Attempt::Ended } else { Attempt::Taken }),
                },
                Err(source) => return Err(cannot_write(path, source)),
            }
        };
        let file = Arc::new(file);
        let claim = Claim { claims: self, address: address.to_owned(), generation, file: Some(file.clone()) };
        self.announce(&file, run).map_err(|source| cannot_write(self.path(address, generation), source))?;
        self.held().push(file);
        if self.has_record(address) {
            claim.finish();
            return Ok(Attempt::Ended);
        }
        Ok(Attempt::Claimed(claim))
    }

    /// Shows that this process is alive, in all claims that it holds. A claim that cannot be
    /// written is left to its lease.
    pub(crate) fn beat(&self) {
        for file in self.held().iter() {
            let _ = mark(file, WORKING);
        }
    }

    /// Time between two heartbeats.
    pub(crate) fn interval(&self) -> Duration {
        self.lease / BEATS
    }

    /// The state of the claim in a file.
    ///
    /// # Errors
    /// [`Error::Io`] where the file server's time cannot be read.
    pub(crate) fn state(&self, path: &Path) -> Result<State, Error> {
        // Opening the file makes an NFS client ask the server for its time and content.
        let opened = File::open(path).and_then(|file| {
            let written = file.metadata()?.modified()?;
            let mut content = Vec::new();
            (&file).take(MOST_BYTES).read_to_end(&mut content)?;
            Ok((file, written, content))
        });
        let (file, written, content) = match opened {
            Ok(found) => found,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(State::Gone),
            // Windows lets nobody read a locked file.
            Err(_) => return Ok(State::Live { note: None, age: Duration::ZERO }),
        };
        if content.starts_with(RELEASED) {
            return Ok(State::Released);
        }
        // A claim without a complete note has just been created, or its owner died then.
        let note: Option<ClaimNote> = content.strip_prefix(WORKING).and_then(|note| serde_json::from_slice(note).ok());
        let is_here = note.as_ref().is_some_and(|note| note.locked && note.system == self.system);
        if is_here && file.try_lock_shared().is_ok() {
            return Ok(State::Expired { note });
        }
        let lease = note.as_ref().and_then(|note| Duration::try_from_secs_f64(note.lease).ok()).unwrap_or(self.lease);
        let age = self.now()?.duration_since(written).unwrap_or_default();
        Ok(if age > lease { State::Expired { note } } else { State::Live { note, age } })
    }

    /// Whether a file was last written longer ago than a lease, by the file server's clock.
    ///
    /// # Errors
    /// [`Error::Io`] where the file server's time cannot be read.
    pub(crate) fn is_old(&self, path: &Path) -> Result<bool, Error> {
        let Ok(written) = File::open(path).and_then(|file| file.metadata()?.modified()) else { return Ok(false) };
        Ok(self.now()?.duration_since(written).is_ok_and(|age| age > self.lease))
    }

    /// The time of the file server, at most [`CLOCK`] old. A time that is too early makes claims
    /// seem younger, so none expires too soon.
    fn now(&self) -> Result<SystemTime, Error> {
        let mut clock = self.clock.lock().unwrap_or_else(PoisonError::into_inner);
        match *clock {
            Some((read, time)) if read.elapsed() < CLOCK => Ok(time),
            _ => {
                let time = self.read_clock()?;
                *clock = Some((Instant::now(), time));
                Ok(time)
            }
        }
    }

    /// The time of the file server: that of a file which is written now.
    fn read_clock(&self) -> Result<SystemTime, Error> {
        let path = self.folder.join(format!("{}.now", system::token()));
        let made = File::create_new(&path).and_then(|mut file| {
            file.write_all(b"now")?;
            flush_to_server(&file)?;
            file.metadata()?.modified()
        });
        let _ = fs::remove_file(&path);
        made.map_err(|source| cannot_write(path, source))
    }

    /// Writes who holds a claim.
    fn announce(&self, file: &File, run: &str) -> io::Result<()> {
        // Locked before the note says so. Where there are no locks, the lease alone decides.
        let locked = file.try_lock().is_ok();
        let (worker, system) = (self.worker.clone(), self.system.clone());
        let note = ClaimNote { worker, run: run.to_owned(), lease: self.lease.as_secs_f64(), system, locked };
        let mut content = WORKING.to_vec();
        serde_json::to_writer(&mut content, &note)?;
        let mut writer = file;
        writer.write_all(&content)?;
        flush_to_server(file)
    }

    fn has_record(&self, address: &str) -> bool {
        fs::symlink_metadata(self.folder.join(run_files::record(address))).is_ok()
    }

    fn path(&self, address: &str, generation: u32) -> PathBuf {
        self.folder.join(run_files::claim(address, generation))
    }

    fn held(&self) -> MutexGuard<'_, Vec<Arc<File>>> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A run that belongs to this process. When dropped, the run is free for others.
#[derive(Debug)]
pub(crate) struct Claim<'a> {
    claims: &'a Claims,
    address: String,
    generation: u32,
    /// `None` once the claim is finished.
    file: Option<Arc<File>>,
}

impl Claim<'_> {
    /// Removes the claim, and those that it took over. The run must have a record.
    pub(crate) fn finish(mut self) {
        // Closed first: an NFS client renames a file that is removed while it is open.
        self.close();
        for generation in 0..=self.generation {
            // Claims of runs that have ended mean nothing; the next report removes what is left.
            let _ = fs::remove_file(self.claims.path(&self.address, generation));
        }
    }

    /// Ends the heartbeats and returns the file.
    fn close(&mut self) -> Option<Arc<File>> {
        let file = self.file.take()?;
        self.claims.held().retain(|held| !Arc::ptr_eq(held, &file));
        Some(file)
    }
}

impl Drop for Claim<'_> {
    fn drop(&mut self) {
        if let Some(file) = self.close() {
            // A claim that cannot be written expires.
            let _ = mark(&file, RELEASED);
        }
    }
}

/// Replaces the first word of a claim, which also renews its time.
fn mark(file: &File, word: &[u8]) -> io::Result<()> {
    let mut writer = file;
    writer.seek(SeekFrom::Start(0))?;
    writer.write_all(word)?;
    flush_to_server(file)
}

/// Makes an NFS client send what was written, so that other machines see it. Closing a descriptor
/// does this, while synchronising would also wait for the disk.
fn flush_to_server(file: &File) -> io::Result<()> {
    file.try_clone().map(drop)
}

fn cannot_write(path: PathBuf, source: io::Error) -> Error {
    gs_io::Error::Write { path, source }.into()
}

#[cfg(test)]
mod tests;
