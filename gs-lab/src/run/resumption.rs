//! Checkpoints of a study's runs: whoever claims a run that was interrupted goes on with it.
//!
//! A checkpoint is next to the place of the run's record until the record is there. It holds the
//! trainer's state and all that the record takes from the steps so far, so that the record is that
//! of a run without an interruption. A digest guards it: what is not exactly the checkpoint of this
//! run is ignored, and the run starts again.
//!
//! Two processes may store checkpoints of the same run, where one that seemed dead comes back. Each
//! replaces the other whole, and every checkpoint of a run leads to the same record.

use std::{
    fmt::Display,
    time::{Duration, Instant},
};

use gs_core::SavedState;
use gs_io::Checkpoint;
use gs_train::{Control, Error as TrainError, Observer, Progress};

use super::{folder::StudyFolder, watcher::Watcher};
use crate::{
    error::Error,
    study::{Run, digest},
};

/// Checkpoints per lease: a process that dies loses less work than others then wait for its runs.
const PER_LEASE: u32 = 4;

/// Storing a checkpoint takes at most this share of the time until the next.
const SHARE_OF_STORING: u32 = 50;

/// Entry of the metadata with the digest of everything else in the checkpoint and of the run's
/// address.
const KEY: &str = "study-run";

/// The checkpoints of a run.
pub(crate) struct RunCheckpoints<'a> {
    folder: &'a StudyFolder,
    run: &'a Run,
    interval: Duration,
}

impl<'a> RunCheckpoints<'a> {
    /// The checkpoints of a run that this process has claimed for a lease.
    pub(crate) fn new(folder: &'a StudyFolder, run: &'a Run, lease: Duration) -> Self {
        Self { folder, run, interval: lease / PER_LEASE }
    }

    /// The stored checkpoint, if there is one.
    fn read(&self) -> Result<Option<Checkpoint>, String> {
        let Some(mut checkpoint) = self.folder.checkpoint(self.run).map_err(|error| error.to_string())? else {
            return Ok(None);
        };
        let digest = checkpoint.metadata.remove(KEY);
        match digest == Some(digest::of_checkpoint(&self.run.address, &checkpoint)) {
            true => Ok(Some(checkpoint)),
            false => Err("its digest is not that of this run, so it is damaged or of another".to_owned()),
        }
    }

    fn store(&self, checkpoint: &mut Checkpoint<SavedState<'_>>) -> Result<(), Error> {
        let digest = digest::of_checkpoint(&self.run.address, checkpoint);
        checkpoint.metadata.insert(KEY.to_owned(), digest);
        self.folder.store_checkpoint(self.run, checkpoint)
    }
}

/// Stops a run where the watcher wants to, and stores checkpoints: now and then, and at the stop.
/// It comes after the observers that add to checkpoints.
pub(crate) struct Interruptions<'a> {
    run: &'a Run,
    watcher: &'a dyn Watcher,
    /// `None` for a run that is not to be resumed.
    checkpoints: Option<RunCheckpoints<'a>>,
    /// When the next checkpoint is due.
    due: Option<Instant>,
    stops: bool,
    has_failed: bool,
}

impl<'a> Interruptions<'a> {
    /// Interruptions of a run from now on.
    pub(crate) fn new(run: &'a Run, watcher: &'a dyn Watcher, checkpoints: Option<RunCheckpoints<'a>>) -> Self {
        let due = checkpoints.as_ref().map(|checkpoints| Instant::now() + checkpoints.interval);
        Self { run, watcher, checkpoints, due, stops: false, has_failed: false }
    }

    /// The checkpoint to go on from; `None` where there is none, or none that can be used.
    pub(crate) fn checkpoint(&self) -> Option<Checkpoint> {
        let read = self.checkpoints.as_ref()?.read();
        read.unwrap_or_else(|why| {
            self.refuse(why);
            None
        })
    }

    /// Says that the checkpoint cannot be used.
    pub(crate) fn refuse(&self, why: impl Display) {
        self.watcher.warned(self.run, &format!("begins anew, as its checkpoint cannot be used: {why}"));
    }

    /// Says that the run goes on after this many steps.
    pub(crate) fn resumed(&self, step: u32) {
        self.watcher.resumed(self.run, step);
    }
}

impl Observer for Interruptions<'_> {
    fn on_step(&mut self, _: &Progress) -> Control {
        self.stops |= self.watcher.wants_stop();
        if self.stops { Control::Stop } else { Control::Continue }
    }

    fn wants_checkpoint(&mut self, progress: &Progress) -> bool {
        // After the last step comes the record.
        !progress.is_last() && self.due.is_some_and(|due| self.stops || Instant::now() >= due)
    }

    /// A full disk does not end the run, which has lost nothing yet.
    fn on_checkpoint(&mut self, checkpoint: &mut Checkpoint<SavedState<'_>>) -> Result<(), TrainError> {
        let Some(checkpoints) = &self.checkpoints else { return Ok(()) };
        let started = Instant::now();
        if let Err(error) = checkpoints.store(checkpoint)
            && !self.has_failed
        {
            self.has_failed = true;
            self.watcher.warned(self.run, &format!("goes on without a checkpoint, which could not be stored: {error}"));
        }
        self.due = Some(Instant::now() + (started.elapsed() * SHARE_OF_STORING).max(checkpoints.interval));
        Ok(())
    }
}
