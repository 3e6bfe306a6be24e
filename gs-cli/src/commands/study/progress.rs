//! The progress of a study: runs done and running, and the time left; a bar on a terminal,
//! otherwise a line now and then.

use std::{
    sync::{Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

use gs_core::{counted, duration};
use gs_lab::{
    Plan, StudyFolder,
    run::{RunOutcome, Watcher},
    study::Run,
};
use indicatif::ProgressBar;

use crate::{
    failure::Failure,
    terminal::{
        interrupt::Interrupt,
        output,
        progress_bar::{Printer, bar},
    },
};

/// Time between two lines if there is no bar.
const LINE: Duration = Duration::from_secs(10);

/// Shows the progress of a study.
pub(crate) struct Display<'a> {
    plan: &'a Plan,
    bar: Option<ProgressBar>,
    started: Instant,
    state: Mutex<State>,
}

struct State {
    running: usize,
    done: usize,
    failed: usize,
    /// Work that this process has done, and that is left, in the unit of [`Plan::work`].
    work_done: f64,
    work_left: f64,
    printed: Instant,
}

impl<'a> Display<'a> {
    /// A display on standard error.
    pub(crate) fn new(plan: &'a Plan, folder: &StudyFolder) -> Result<Self, Failure> {
        let ended = folder.ended()?;
        let (done, pending): (Vec<&Run>, Vec<&Run>) = plan.runs.iter().partition(|run| ended.contains(&run.address));
        let bar = bar(plan.runs.len() as u64, "{bar:20} {pos}/{len} runs  {msg}");
        let bar = bar.map(|bar| bar.with_position(done.len() as u64));
        let work_left = pending.iter().map(|run| plan.work(run)).sum();
        let now = Instant::now();
        let state = State { running: 0, done: done.len(), failed: 0, work_done: 0.0, work_left, printed: now };
        Ok(Self { plan, bar, started: now, state: Mutex::new(state) })
    }

    /// Prints without disturbing the display.
    pub(crate) fn printer(&self) -> Printer {
        Printer::above(self.bar.clone())
    }

    /// A watcher that also stops on Ctrl-C.
    pub(crate) fn stopped_by<'b>(&'b self, interrupt: &'b Interrupt) -> Watched<'b> {
        Watched { display: self, interrupt }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn update(&self, change: impl FnOnce(&mut State)) {
        let mut state = self.lock();
        change(&mut state);
        let message = state.message(self.started.elapsed());
        match &self.bar {
            Some(bar) => {
                bar.set_position(state.done as u64);
                bar.set_message(message);
            }
            // Between two runs of one process none is running, so the line waits for the next one.
            None if state.is_worth_a_line(self.plan.runs.len()) => {
                state.printed = Instant::now();
                let runs = counted(self.plan.runs.len(), "run");
                output::note(format_args!("{}/{runs}  {message}", state.done));
            }
            None => {}
        }
    }
}

impl State {
    /// Whether to print a line: now and then while something runs, and at the end.
    fn is_worth_a_line(&self, runs: usize) -> bool {
        match self.running {
            0 => self.done == runs,
            _ => self.printed.elapsed() >= LINE,
        }
    }

    fn message(&self, elapsed: Duration) -> String {
        let failed = if self.failed > 0 { format!("{} failed  ", self.failed) } else { String::new() };
        let left = match self.work_done > 0.0 {
            true => duration(elapsed.as_secs_f64() * self.work_left / self.work_done),
            false => "some time".to_owned(),
        };
        format!("{} running  {failed}{left} left", self.running)
    }
}

/// A display that also stops on Ctrl-C.
pub(crate) struct Watched<'a> {
    display: &'a Display<'a>,
    interrupt: &'a Interrupt,
}

impl Watcher for Watched<'_> {
    fn begun(&self, _: &Run) {
        self.display.update(|state| state.running += 1);
    }

    fn ended(&self, run: &Run, outcome: &RunOutcome) {
        let plan = self.display.plan;
        if let RunOutcome::Failed { error } = outcome {
            self.display.printer().print(format_args!("row {} ({}) failed: {error}", run.row, plan.describe(run)));
        }
        self.display.update(|state| {
            let work = plan.work(run);
            state.running -= 1;
            state.done += 1;
            state.failed += usize::from(matches!(outcome, RunOutcome::Failed { .. }));
            state.work_done += work;
            state.work_left -= work;
        });
    }

    fn warned(&self, run: &Run, message: &str) {
        let plan = self.display.plan;
        self.display.printer().print(format_args!("note: row {} ({}): {message}", run.row, plan.describe(run)));
    }

    fn counted(&self, ended: usize) {
        if self.display.lock().done != ended {
            self.display.update(|state| state.done = ended);
        }
    }

    fn wants_stop(&self) -> bool {
        self.interrupt.requested()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_left_follows_the_work_rather_than_the_number_of_runs() {
        let state = |work_done, work_left| State {
            running: 2,
            done: 5,
            failed: 1,
            work_done,
            work_left,
            printed: Instant::now(),
        };
        assert_eq!(state(1.0, 3.0).message(Duration::from_secs(10)), "2 running  1 failed  30 s left");
        assert!(state(0.0, 3.0).message(Duration::ZERO).contains("some time left"));
    }
}
