//! Runs in a thread of their own, which Python follows and stops.

use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    process,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError, Weak,
        atomic::{AtomicBool, Ordering::Relaxed},
        mpsc::{Receiver, RecvTimeoutError, channel},
    },
    thread::{self, JoinHandle},
    time::Duration,
};

use pyo3::{exceptions::PyRuntimeError, prelude::*};

use super::progress::{History, Progress, Reporter};
use crate::convert::errors::{self, IntoPython, Raised};

/// Time between two looks for Ctrl-C.
const SIGNALS: Duration = Duration::from_millis(50);

/// What the thread of a run and the threads of Python share.
#[derive(Debug, Default)]
pub(super) struct Shared {
    pub(super) stops: AtomicBool,
    pub(super) raised: Raised,
    has_ended: AtomicBool,
}

/// Why there is no result.
pub(super) enum Failure {
    Error(PyErr),
    Stopped,
}

impl<E: IntoPython> From<E> for Failure {
    fn from(error: E) -> Self {
        Self::Error(error.into_python())
    }
}

/// A run in a thread of its own.
#[derive(Debug)]
pub(super) struct Worker<T> {
    shared: Arc<Shared>,
    reports: Mutex<Receiver<Progress>>,
    state: Mutex<State<T>>,
    process: u32,
}

#[derive(Debug)]
enum State<T> {
    Running(JoinHandle<Result<(T, History), Failure>>),
    Done(Arc<(T, History)>),
    Failed,
}

/// The runs of this process that may be under way.
static RUNS: Mutex<Vec<(u32, Weak<Shared>)>> = Mutex::new(Vec::new());

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl<T: Send + Sync + 'static> Worker<T> {
    pub(super) fn spawn(
        shared: Arc<Shared>,
        work: impl FnOnce(&mut Reporter) -> Result<T, Failure> + Send + 'static,
    ) -> PyResult<Self> {
        let (sender, receiver) = channel();
        let mut reporter = Reporter::new(shared.clone(), sender);
        let body = move || {
            let done = catch_unwind(AssertUnwindSafe(|| work(&mut reporter)));
            let done = done.unwrap_or_else(|panic| Err(Failure::Error(errors::of_panic(&*panic))));
            let shared = reporter.shared.clone();
            let done = done.map(|done| (done, reporter.history()));
            shared.has_ended.store(true, Relaxed);
            done
        };
        let mut runs = locked(&RUNS);
        runs.retain(|(_, run)| run.strong_count() > 0);
        runs.push((process::id(), Arc::downgrade(&shared)));
        drop(runs);
        let thread = thread::Builder::new().name("gs-run".to_owned()).spawn(body);
        let thread = thread.map_err(|error| PyRuntimeError::new_err(format!("cannot start a thread: {error}")))?;
        let (reports, state) = (Mutex::new(receiver), Mutex::new(State::Running(thread)));
        Ok(Self { shared, reports, state, process: process::id() })
    }

    /// The next report; `None` when the run has ended.
    pub(super) fn next(&self, py: Python<'_>) -> PyResult<Option<Progress>> {
        self.check_process()?;
        loop {
            match py.detach(|| locked(&self.reports).recv_timeout(SIGNALS)) {
                Ok(progress) => return Ok(Some(progress)),
                Err(RecvTimeoutError::Disconnected) => {
                    self.result(py)?;
                    return Ok(None);
                }
                Err(RecvTimeoutError::Timeout) => self.check_signals(py)?,
            }
        }
    }

    /// Lets the run stop at its next step.
    pub(super) fn stop(&self) {
        self.shared.stops.store(true, Relaxed);
    }

    /// The thread of a run does not come along when a process is forked.
    fn check_process(&self) -> PyResult<()> {
        if self.process == process::id() {
            return Ok(());
        }
        Err(PyRuntimeError::new_err("the run belongs to the process that this one was forked from"))
    }

    /// Stops the run where Python has been interrupted.
    fn check_signals(&self, py: Python<'_>) -> PyResult<()> {
        let interrupted = py.check_signals();
        if interrupted.is_err() {
            self.stop();
            // The checkpoint is written before Python goes on.
            let _ = self.result(py);
        }
        interrupted
    }

    /// Waits for the end.
    pub(super) fn result(&self, py: Python<'_>) -> PyResult<Arc<(T, History)>> {
        self.check_process()?;
        loop {
            // Nobody waits for the lock and for the interpreter at once.
            let is_done = py.detach(|| match &*locked(&self.state) {
                State::Running(thread) => thread.is_finished(),
                State::Done(_) | State::Failed => true,
            });
            if is_done {
                break;
            }
            py.detach(|| thread::sleep(Duration::from_millis(1)));
            if !self.shared.stops.load(Relaxed) {
                self.check_signals(py)?;
            }
        }
        let ended = py.detach(|| {
            let mut state = locked(&self.state);
            match std::mem::replace(&mut *state, State::Failed) {
                State::Done(done) => {
                    *state = State::Done(done.clone());
                    Ok(done)
                }
                State::Running(thread) => match thread.join() {
                    Ok(Ok(done)) => {
                        let done = Arc::new(done);
                        *state = State::Done(done.clone());
                        Ok(done)
                    }
                    Ok(Err(failure)) => Err(Some(failure)),
                    Err(panic) => Err(Some(Failure::Error(errors::of_panic(&*panic)))),
                },
                State::Failed => Err(None),
            }
        });
        ended.map_err(|failure| match failure {
            Some(Failure::Error(error)) => locked(&self.shared.raised).take().unwrap_or(error),
            Some(Failure::Stopped) => PyRuntimeError::new_err("the run was stopped before its end"),
            None => PyRuntimeError::new_err("the run has no result: it failed or was stopped before its end"),
        })
    }
}

impl<T> Drop for Worker<T> {
    fn drop(&mut self) {
        self.shared.stops.store(true, Relaxed);
    }
}

/// Stops all runs of this process and waits for their ends. Python calls it when it exits, since a
/// thread that calls a policy in an interpreter that is gone would abort the process.
#[pyfunction]
pub(crate) fn stop_runs(py: Python<'_>) {
    let id = process::id();
    let of_here = |(process, run): &(u32, Weak<Shared>)| run.upgrade().filter(|_| *process == id);
    let runs: Vec<Arc<Shared>> = locked(&RUNS).iter().filter_map(of_here).collect();
    runs.iter().for_each(|run| run.stops.store(true, Relaxed));
    py.detach(|| {
        while runs.iter().any(|run| !run.has_ended.load(Relaxed)) {
            thread::sleep(Duration::from_millis(1));
        }
    });
}
