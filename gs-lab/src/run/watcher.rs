//! Watches jobs that are done: the runs of a study, or blocks.

use std::fmt;

use gs_jobs::Overseer;

use super::record::RunOutcome;
use crate::study::Run;

/// What processes share: a run of a study, or a block by its number from 0.
pub trait Job: Sync {
    /// How it ends.
    type Outcome: fmt::Display;
}

impl Job for Run {
    type Outcome = RunOutcome;
}

/// Watches jobs; called from several threads. `()` ignores everything.
pub trait Watcher<J: Job = Run>: Sync {
    /// A job has begun.
    fn begun(&self, job: &J) {
        let _ = job;
    }

    /// A job that has begun goes on from a checkpoint after this many steps.
    fn resumed(&self, job: &J, step: u32) {
        let _ = (job, step);
    }

    /// Something went wrong that costs time but changes no result, such as that a checkpoint could not
    /// be stored.
    fn warned(&self, job: &J, message: &str) {
        let _ = (job, message);
    }

    /// A job has ended, and its outcome is stored.
    fn ended(&self, job: &J, outcome: &J::Outcome) {
        let _ = (job, outcome);
    }

    /// The folder has records of this many jobs, done by this process or others.
    fn counted(&self, ended: usize) {
        let _ = ended;
    }

    /// Whether to stop. Jobs in progress are given back, each with a checkpoint.
    fn wants_stop(&self) -> bool {
        false
    }
}

impl<J: Job> Watcher<J> for () {}

impl<J: Job> Overseer for &dyn Watcher<J> {
    fn counted(&self, ended: usize) {
        (**self).counted(ended);
    }

    fn wants_stop(&self) -> bool {
        (**self).wants_stop()
    }
}
