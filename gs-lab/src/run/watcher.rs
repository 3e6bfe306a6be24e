//! Watches the runs of a study.

use gs_jobs::Overseer;

use super::{record::RunOutcome, resumption::Conductor};
use crate::study::Run;

/// Watches a study; called from several threads. `()` ignores everything.
pub trait Watcher: Sync {
    /// A run has begun.
    fn begun(&self, run: &Run) {
        let _ = run;
    }

    /// A run that has begun goes on from a checkpoint after this many steps.
    fn resumed(&self, run: &Run, step: u32) {
        let _ = (run, step);
    }

    /// Something went wrong that costs time but changes no result, such as that a checkpoint of a run
    /// could not be stored.
    fn warned(&self, run: &Run, message: &str) {
        let _ = (run, message);
    }

    /// A run has ended, and its outcome is stored.
    fn ended(&self, run: &Run, outcome: &RunOutcome) {
        let _ = (run, outcome);
    }

    /// The folder has records of this many runs of the study, done by this process or others.
    fn counted(&self, ended: usize) {
        let _ = ended;
    }

    /// Whether to stop. Runs in progress are given back, each with a checkpoint.
    fn wants_stop(&self) -> bool {
        false
    }
}

impl Watcher for () {}

impl Overseer for &dyn Watcher {
    fn counted(&self, ended: usize) {
        (**self).counted(ended);
    }

    fn wants_stop(&self) -> bool {
        (**self).wants_stop()
    }
}

/// The watcher of one run.
pub(crate) struct OfRun<'a> {
    pub(crate) run: &'a Run,
    pub(crate) watcher: &'a dyn Watcher,
}

impl Conductor for OfRun<'_> {
    fn wants_stop(&self) -> bool {
        self.watcher.wants_stop()
    }

    fn warned(&self, message: &str) {
        self.watcher.warned(self.run, message);
    }

    fn resumed(&self, step: u32) {
        self.watcher.resumed(self.run, step);
    }
}
