//! Checkpoints of jobs that train: whoever claims a job that was interrupted goes on with it.
//!
//! A checkpoint is next to the place of the job's record until the record is there. It holds the
//! trainer's state and all that the record takes from the steps so far, so that the record is that
//! of a job without an interruption. A digest guards it: what is not exactly the checkpoint of this
//! job is ignored, and the job starts again.
//!
//! Two processes may store checkpoints of the same job, where one that seemed dead comes back. Each
//! replaces the other whole, and every checkpoint of a job leads to the same record.

use std::{
    fmt::Display,
    path::Path,
    time::{Duration, Instant},
};

use gs_core::SavedState;
use gs_io::{Checkpoint, decode_checkpoint, encode_checkpoint};
use gs_jobs::{JobStore, Keep, files};
use gs_train::{Control, Error as TrainError, Observer, Progress};

use super::watcher::{Job, Watcher};
use crate::{
    error::Error,
    study::{Run, digest},
};

/// Checkpoints per lease: a process that dies loses less work than others then wait for its runs.
const PER_LEASE: u32 = 4;

/// Storing a checkpoint takes at most this share of the time until the next.
const SHARE_OF_STORING: u32 = 50;

/// Entry of the metadata with the digest of everything else in the checkpoint and of the job's
/// address.
const KEY: &str = "study-run";

/// The checkpoints of a job.
pub(crate) struct JobCheckpoints<'a> {
    store: &'a JobStore,
    address: &'a str,
    interval: Duration,
}

impl<'a> JobCheckpoints<'a> {
    /// The checkpoints of a job that this process has claimed for a lease.
    pub(crate) fn new(store: &'a JobStore, address: &'a str, lease: Duration) -> Self {
        Self { store, address, interval: lease / PER_LEASE }
    }

    /// The stored checkpoint, if there is one.
    fn read(&self) -> Result<Option<Checkpoint>, String> {
        let name = files::checkpoint(self.address);
        let bytes = self.store.read(&name).map_err(|error| error.to_string())?;
        let decoded = bytes.map(|bytes| decode_checkpoint(&bytes, Path::new(&name))).transpose();
        let Some(mut checkpoint) = decoded.map_err(|error| error.to_string())? else { return Ok(None) };
        let digest = checkpoint.metadata.remove(KEY);
        match digest == Some(digest::of_checkpoint(self.address, &checkpoint)) {
            true => Ok(Some(checkpoint)),
            false => Err("its digest is not that of this run, so it is damaged or of another".to_owned()),
        }
    }

    fn store(&self, checkpoint: &mut Checkpoint<SavedState<'_>>) -> Result<(), Error> {
        let digest = digest::of_checkpoint(self.address, checkpoint);
        checkpoint.metadata.insert(KEY.to_owned(), digest);
        let name = files::checkpoint(self.address);
        Ok(self.store.write(&name, Keep::AfterPowerCut, &mut |file| encode_checkpoint(file, checkpoint))?)
    }
}

/// Removes the checkpoint of a job that has a record. What cannot be removed does no harm.
pub(crate) fn remove_checkpoint(store: &JobStore, address: &str) {
    let _ = store.remove(&files::checkpoint(address));
}

/// Stops a job where its watcher wants to, and stores checkpoints: now and then, and at the stop.
/// It comes after the observers that add to checkpoints.
pub(crate) struct Interruptions<'a, J: Job = Run> {
    job: &'a J,
    watcher: &'a dyn Watcher<J>,
    checkpoints: JobCheckpoints<'a>,
    /// When the next checkpoint is due.
    due: Instant,
    stops: bool,
    has_failed: bool,
}

impl<'a, J: Job> Interruptions<'a, J> {
    /// Interruptions of a job from now on.
    pub(crate) fn new(job: &'a J, watcher: &'a dyn Watcher<J>, checkpoints: JobCheckpoints<'a>) -> Self {
        let due = Instant::now() + checkpoints.interval;
        Self { job, watcher, checkpoints, due, stops: false, has_failed: false }
    }

    /// The checkpoint to go on from; `None` where there is none, or none that can be used.
    pub(crate) fn checkpoint(&self) -> Option<Checkpoint> {
        self.checkpoints.read().unwrap_or_else(|why| {
            self.refuse(why);
            None
        })
    }

    /// Says that the checkpoint cannot be used.
    pub(crate) fn refuse(&self, why: impl Display) {
        self.watcher.warned(self.job, &format!("begins anew, as its checkpoint cannot be used: {why}"));
    }

    /// Says that the job goes on after this many steps.
    pub(crate) fn resumed(&self, step: u32) {
        self.watcher.resumed(self.job, step);
    }
}

impl<J: Job> Observer for Interruptions<'_, J> {
    fn on_step(&mut self, _: &Progress) -> Control {
        self.stops |= self.watcher.wants_stop();
        if self.stops { Control::Stop } else { Control::Continue }
    }

    fn wants_checkpoint(&mut self, progress: &Progress) -> bool {
        // After the last step comes the record.
        !progress.is_last() && (self.stops || Instant::now() >= self.due)
    }

    /// A full disk does not end the run, which has lost nothing yet.
    fn on_checkpoint(&mut self, checkpoint: &mut Checkpoint<SavedState<'_>>) -> Result<(), TrainError> {
        let started = Instant::now();
        if let Err(error) = self.checkpoints.store(checkpoint)
            && !self.has_failed
        {
            self.has_failed = true;
            self.watcher.warned(self.job, &format!("goes on without a checkpoint, which could not be stored: {error}"));
        }
        self.due = Instant::now() + (started.elapsed() * SHARE_OF_STORING).max(self.checkpoints.interval);
        Ok(())
    }
}
