//! The order in which a process claims jobs, and what it does when all others are
//! taken.

use std::{
    collections::VecDeque,
    sync::{Condvar, Mutex, MutexGuard, PoisonError, mpsc},
    thread,
    time::{Duration, Instant},
};

use super::{
    claims::{Attempt, Claim, Claims},
    files::Listing,
    store::JobStore,
    system,
    work::{AtEnd, WorkSettings},
};
use crate::error::Error;

/// Most claims of others that a process examines each time it looks for a dead owner. Many
/// processes wait at the end of jobs, and each begins elsewhere, so together they examine all.
const MOST_EXAMINED: usize = 32;

/// Fewest jobs in a row that could not be claimed before a process looks at the folder again.
const FEWEST_MISSES: usize = 64;

/// First pause between two looks at the folder. Each is twice as long as the one before.
const FIRST_PAUSE: Duration = Duration::from_millis(250);

/// Looks at the folder take at most one part in this many of the time, unless the next would be later than a lease
/// from now.
const SHARE_OF_LOOKING: u32 = 50;

/// Longest time in which a request to stop is not noticed.
const NOTICE: Duration = Duration::from_millis(100);

/// What a queue reports to and asks while it waits; `()` ignores everything and never stops.
pub trait Overseer {
    /// This many of the jobs have ended, by this process or others.
    fn counted(&self, ended: usize) {
        let _ = ended;
    }

    /// Whether no further job is to begin.
    fn wants_stop(&self) -> bool {
        false
    }
}

impl Overseer for () {}

/// The jobs that this process may still claim. Threads share it.
#[derive(Debug)]
pub struct Queue<'a> {
    /// The addresses of all jobs, in the order given.
    addresses: Vec<&'a str>,
    store: JobStore,
    claims: Claims,
    settings: &'a WorkSettings,
    order: Mutex<Order>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct Order {
    /// Jobs to claim, by their places in the list.
    candidates: VecDeque<usize>,
    /// How far to step after a job that another process has claimed.
    stride: usize,
    /// Runs in a row that could not be claimed.
    misses: usize,
    /// Whether no further job is to begin.
    closed: bool,
    /// When to look at the folder again.
    next_look: Option<Instant>,
    pause: Duration,
    /// Since when all jobs left have been with others.
    idle_since: Option<Instant>,
    /// Whether the process leaves unless it can take a job over now.
    is_last: bool,
}

/// The result of a look at the folder.
enum Look {
    Candidates,
    Wait(Duration),
    Nothing,
}

impl<'a> Queue<'a> {
    /// A queue of jobs whose records and claims are in `store`.
    pub fn new(addresses: Vec<&'a str>, store: JobStore, settings: &'a WorkSettings) -> Self {
        let claims = Claims::new(store.clone(), settings.worker.clone(), settings.lease);
        Self { addresses, store, claims, settings, order: Mutex::default(), changed: Condvar::new() }
    }

    /// Claims the next job: its place in the list, and the claim. Waits while all jobs that are
    /// left are with others, as [`WorkSettings::at_end`] says. Returns `None` where nothing is
    /// left, and where the overseer wants to stop. `words` describes a job for people.
    ///
    /// # Errors
    /// [`Error::Path`] and [`Error::Write`] where the folder cannot be read or written to.
    pub fn next(
        &self,
        words: impl Fn(usize) -> String,
        overseer: &dyn Overseer,
    ) -> Result<Option<(usize, Claim<'_>)>, Error> {
        self.look_again();
        while !overseer.wants_stop() {
            let candidate = self.order().pop();
            if let Some(index) = candidate {
                match self.claims.attempt(self.addresses[index], &words(index))? {
                    Attempt::Claimed(claim) => {
                        self.order().found();
                        return Ok(Some((index, claim)));
                    }
                    Attempt::Ended => self.order().miss(0),
                    Attempt::Taken => self.order().step_aside(),
                }
                continue;
            }
            match self.look(overseer)? {
                Look::Candidates => {}
                Look::Wait(time) => self.wait(time.min(NOTICE)),
                Look::Nothing => break,
            }
        }
        Ok(None)
    }

    /// No further job begins.
    pub fn close(&self) {
        self.order().closed = true;
        self.changed.notify_all();
    }

    /// Number of jobs that have no record.
    ///
    /// # Errors
    /// [`Error::Path`] where the folder cannot be read.
    pub fn left(&self) -> Result<usize, Error> {
        let ended = Listing::of(&self.store)?.ended;
        Ok(self.addresses.iter().filter(|&&address| !ended.contains(address)).count())
    }

    /// Does work, during which a thread shows that the owner of this process' claims is alive.
    pub fn keep_alive<T>(&self, work: impl FnOnce() -> T) -> T {
        let (working, ended) = mpsc::channel::<()>();
        thread::scope(|scope| {
            scope.spawn(move || {
                while ended.recv_timeout(self.claims.interval()) == Err(mpsc::RecvTimeoutError::Timeout) {
                    self.claims.beat();
                }
            });
            // Dropped at the end of the work, even if it panics.
            let _working = working;
            work()
        })
    }

    /// Called when a job of this process has ended: the folder has changed.
    fn look_again(&self) {
        let mut order = self.order();
        (order.next_look, order.idle_since, order.is_last) = (None, None, false);
        self.changed.notify_all();
    }

    fn wait(&self, time: Duration) {
        drop(self.changed.wait_timeout(self.order(), time).unwrap_or_else(PoisonError::into_inner));
    }

    /// Lists the folder, if it is time to, and queues the jobs that are free; if there are none,
    /// some of those that others have claimed, whose owners may be dead.
    fn look(&self, overseer: &dyn Overseer) -> Result<Look, Error> {
        let mut order = self.order();
        let now = Instant::now();
        match order.next_look {
            _ if order.closed => return Ok(Look::Nothing),
            _ if !order.candidates.is_empty() => return Ok(Look::Candidates),
            Some(time) if now < time => return Ok(Look::Wait(time - now)),
            Some(_) if order.is_last => return Ok(Look::Nothing),
            _ => {}
        }
        let listing = Listing::of(&self.store)?;
        let left = (0..self.addresses.len()).filter(|&index| !listing.ended.contains(self.addresses[index]));
        let (taken, free): (Vec<usize>, Vec<usize>) =
            left.partition(|&index| listing.claimed.contains_key(self.addresses[index]));
        overseer.counted(self.addresses.len() - taken.len() - free.len());
        if taken.is_empty() && free.is_empty() {
            return Ok(Look::Nothing);
        }
        if !free.is_empty() {
            let share = |index: &usize| self.settings.shard.is_none_or(|shard| shard.contains(*index));
            let (own, others): (VecDeque<usize>, VecDeque<usize>) = free.into_iter().partition(share);
            // After its share, a process looks again: by then, others have done most of theirs.
            *order = Order { candidates: if own.is_empty() { others } else { own }, ..Order::default() };
            return Ok(Look::Candidates);
        }
        let idle_since = *order.idle_since.get_or_insert(now);
        let leaves = idle_since + self.settings.lease;
        order.is_last = self.settings.at_end == AtEnd::Leave && now >= leaves;
        order.pause = (order.pause * 2).clamp(FIRST_PAUSE, (self.settings.lease / 8).max(FIRST_PAUSE));
        let next = now + pause_after(now.elapsed(), order.pause, self.settings.lease);
        order.next_look = Some(match self.settings.at_end {
            AtEnd::Leave if !order.is_last => next.min(leaves),
            AtEnd::Leave => now,
            AtEnd::Wait => next,
        });
        order.candidates = some(taken);
        Ok(Look::Candidates)
    }

    fn order(&self) -> MutexGuard<'_, Order> {
        self.order.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Order {
    fn pop(&mut self) -> Option<usize> {
        if self.closed { None } else { self.candidates.pop_front() }
    }

    /// A job was claimed.
    fn found(&mut self) {
        (self.stride, self.misses) = (0, 0);
    }

    /// Steps over some candidates, twice as many each time up to half of them, after one was taken
    /// by another process: where many begin at the same place, they disperse.
    fn step_aside(&mut self) {
        self.stride = (2 * self.stride).min(self.candidates.len() / 2).max(1);
        self.miss(self.stride);
    }

    /// Steps over candidates after one that could not be claimed. After many, the list is out of
    /// date, and looking at the folder costs less than trying them all.
    fn miss(&mut self, step: usize) {
        self.misses += 1;
        if self.misses > FEWEST_MISSES.max(self.candidates.len() / 64) {
            self.candidates.clear();
            self.misses = 0;
        }
        self.candidates.rotate_left(step.min(self.candidates.len()));
    }
}

/// At most [`MOST_EXAMINED`] of these, from a random place on.
fn some(mut of: Vec<usize>) -> VecDeque<usize> {
    if of.len() > MOST_EXAMINED {
        let place = u64::from_str_radix(&system::token(), 16).unwrap_or_default() % of.len() as u64;
        of.rotate_left(place as usize);
        of.truncate(MOST_EXAMINED);
    }
    of.into()
}

/// The time from a look at the folder, which took `looking`, to the next.
fn pause_after(looking: Duration, pause: Duration, lease: Duration) -> Duration {
    pause.max((looking * SHARE_OF_LOOKING).min(lease))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slow_looks_are_rare_but_no_lease_apart() {
        let seconds = Duration::from_secs;
        let after = |looking: Duration| pause_after(looking, seconds(2), seconds(120));
        assert_eq!([after(Duration::ZERO), after(seconds(1)), after(seconds(10))], [2, 50, 120].map(seconds));
    }
}
