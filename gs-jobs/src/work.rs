//! How a process takes part in work that others do, too.

use std::{process, time::Duration};

use super::system;
use crate::error::Error;

/// The part of jobs that a process begins with. When it has ended, the process helps with the
/// other parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    /// Which part, from 0.
    pub index: u32,
    /// The number of parts.
    pub count: u32,
}

impl Shard {
    /// Whether the part has the job at this place, counted from 0. Parts are interleaved: each has
    /// jobs of all seeds, budgets and images.
    pub(crate) fn contains(self, place: usize) -> bool {
        place % self.count as usize == self.index as usize
    }
}

/// What a process does when all jobs that are left are with other processes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum AtEnd {
    /// It waits until every job has ended.
    #[default]
    Wait,
    /// It takes over the jobs of processes that are dead, and leaves after one lease without any.
    Leave,
}

/// How a process takes part in the jobs.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct WorkSettings {
    /// The process in words, for people who look at claims; by default its machine and its number.
    pub worker: String,
    /// The part of the jobs to begin with; `None` begins at the first job.
    pub shard: Option<Shard>,
    /// Time after which others take over the jobs of this process unless it shows that it is alive,
    /// which it does six times as often. At least 1 s, at most a day; by default 2 minutes, which
    /// outlasts the restart of a file server.
    pub lease: Duration,
    /// What to do when all jobs that are left are with other processes.
    pub at_end: AtEnd,
}

impl Default for WorkSettings {
    fn default() -> Self {
        let worker = format!("{}, process {}", system::host(), process::id());
        Self { worker, shard: None, lease: Duration::from_secs(120), at_end: AtEnd::Wait }
    }
}

impl WorkSettings {
    /// Returns these settings after `change`, which assigns fields: `settings.with(|s|
    /// s.field = value)`.
    #[must_use]
    pub fn with(mut self, change: impl FnOnce(&mut Self)) -> Self {
        change(&mut self);
        self
    }

    /// Fails where a setting is out of its range.
    ///
    /// # Errors
    /// [`Error::Work`] with the setting and its range.
    pub fn validate(&self) -> Result<(), Error> {
        let wrong = |message: String| Err(Error::Work { message });
        if let Some(Shard { index, count }) = self.shard.filter(|shard| shard.index >= shard.count) {
            return wrong(format!("shard is {index}/{count}: parts are counted from 0, so the last is {count} less 1"));
        }
        if !(Duration::from_secs(1)..=Duration::from_secs(86_400)).contains(&self.lease) {
            return wrong(format!("lease is {} s, but must be from 1 s to a day", self.lease.as_secs_f64()));
        }
        Ok(())
    }
}
