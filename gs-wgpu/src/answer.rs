//! Answers of the device as futures. On native platforms a thread polls the device while answers
//! are pending; in a browser, the browser does.

use std::{
    future::poll_fn,
    sync::{Arc, Mutex, PoisonError},
    task::{Poll, Waker},
};

/// A future answer of the device: whether an operation succeeded.
#[derive(Debug, Clone, Default)]
pub(crate) struct Answer(Arc<Mutex<State>>);

#[derive(Debug, Default)]
struct State {
    given: Option<bool>,
    waker: Option<Waker>,
}

impl Answer {
    /// Sets the answer, unless it is already set.
    pub(crate) fn give(&self, answer: bool) {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        state.given.get_or_insert(answer);
        let waker = state.waker.take();
        drop(state);
        if let Some(waker) = waker {
            waker.wake();
        }
    }

    /// The answer, if it has arrived.
    pub(crate) fn given(&self) -> Option<bool> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).given
    }

    /// Waits for the answer.
    pub(crate) async fn wait(&self) -> bool {
        poll_fn(|context| {
            let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            match state.given {
                Some(answer) => Poll::Ready(answer),
                None => {
                    state.waker = Some(context.waker().clone());
                    Poll::Pending
                }
            }
        })
        .await
    }
}

#[cfg(not(target_family = "wasm"))]
pub(crate) use native::Poller;

#[cfg(not(target_family = "wasm"))]
mod native {
    use std::{
        sync::{
            OnceLock,
            mpsc::{Receiver, Sender, channel},
        },
        thread::{self, JoinHandle},
        time::{Duration, Instant},
    };

    use super::Answer;
    use crate::fault::Faults;

    /// Longest wait for a submission. Drivers abort a submission much earlier.
    const LONGEST_WAIT: Duration = Duration::from_secs(600);

    /// Longest wait for the callbacks of a finished submission.
    const MOST_PATIENCE: Duration = Duration::from_secs(60);

    /// A submission, and the answer that arrives when it is done.
    type Pending = (wgpu::SubmissionIndex, Answer);

    /// The channel to the polling thread, and the thread; `None` if it could not be started.
    type Running = Option<(Sender<Pending>, JoinHandle<()>)>;

    /// A thread that polls the device. It starts on first use and ends when this is dropped.
    #[derive(Debug, Default)]
    pub(crate) struct Poller(OnceLock<Running>);

    impl Poller {
        /// Polls the device until the answer arrives.
        pub(crate) fn expect(
            &self,
            device: &wgpu::Device,
            faults: &Faults,
            submission: &wgpu::SubmissionIndex,
            answer: &Answer,
        ) {
            let running = self.0.get_or_init(|| {
                let (sender, pending) = channel();
                let (device, faults) = (device.clone(), faults.clone());
                let thread = thread::Builder::new().name("gs-wgpu".to_owned());
                let thread = thread.spawn(move || poll(&device, &faults, &pending)).ok()?;
                Some((sender, thread))
            });
            let pending = || (submission.clone(), answer.clone());
            let sent = running.as_ref().is_some_and(|(sender, _)| sender.send(pending()).is_ok());
            if !sent {
                faults.note("cannot start the thread that polls the device".to_owned());
                answer.give(false);
            }
        }
    }

    impl Drop for Poller {
        fn drop(&mut self) {
            if let Some((sender, thread)) = self.0.take().flatten() {
                drop(sender);
                // The thread holds the device, which must be dropped before the process ends.
                let _panicked = thread.join();
            }
        }
    }

    fn poll(device: &wgpu::Device, faults: &Faults, pending: &Receiver<Pending>) {
        for (submission, answer) in pending {
            if answer.given().is_none() {
                let wait = wgpu::PollType::Wait { submission_index: Some(submission), timeout: Some(LONGEST_WAIT) };
                match device.poll(wait) {
                    Ok(_) => {}
                    Err(wgpu::PollError::Timeout) => faults.note(format!(
                        "the device has not answered for {} s: its driver hangs, restart the program",
                        LONGEST_WAIT.as_secs()
                    )),
                    Err(e) => faults.note(format!("waiting for the device: {e}")),
                }
                // If another thread polls, too, its callbacks may run a little later.
                let end = Instant::now() + MOST_PATIENCE;
                while answer.given().is_none() && faults.check().is_ok() && Instant::now() < end {
                    thread::sleep(Duration::from_millis(1));
                }
            }
            answer.give(false);
        }
    }
}
