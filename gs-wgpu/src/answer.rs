//! What the device answers, as futures: nothing here waits, but on native platforms a thread of the device's own polls it while answers
//! are pending. In a browser, the browser does.

use std::{
    future::poll_fn,
    sync::{Arc, Mutex, PoisonError},
    task::{Poll, Waker},
};

/// Whether something could be done, once the device has said so.
#[derive(Debug, Clone, Default)]
pub(crate) struct Answer(Arc<Mutex<State>>);

#[derive(Debug, Default)]
struct State {
    given: Option<bool>,
    waker: Option<Waker>,
}

impl Answer {
    /// Gives the answer, unless there is one.
    pub(crate) fn give(&self, answer: bool) {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        state.given.get_or_insert(answer);
        let waker = state.waker.take();
        drop(state);
        if let Some(waker) = waker {
            waker.wake();
        }
    }

    /// The answer, if it is there.
    pub(crate) fn given(&self) -> Option<bool> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).given
    }

    /// The answer, once it is there.
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
    use crate::gpu::Faults;

    /// A driver that does not answer for so long never will: drivers give up on a single submission far earlier.
    const LONGEST_WAIT: Duration = Duration::from_secs(600);

    /// How long the device may take to hand over what it has finished.
    const MOST_PATIENCE: Duration = Duration::from_secs(60);

    /// An answer that comes when a submission has been done.
    type Pending = (wgpu::SubmissionIndex, Answer);

    /// Where answers are asked for, and the thread that waits for them; nothing where none can be started.
    type Running = Option<(Sender<Pending>, JoinHandle<()>)>;

    /// A thread that waits for the device, so that nobody else has to. It is started when it is first needed, and ends with this.
    #[derive(Debug, Default)]
    pub(crate) struct Poller(OnceLock<Running>);

    impl Poller {
        /// Sees to it that the answer comes.
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
                faults.note("no thread can be started that waits for the device".to_owned());
                answer.give(false);
            }
        }
    }

    impl Drop for Poller {
        fn drop(&mut self) {
            if let Some((sender, thread)) = self.0.take().flatten() {
                drop(sender);
                // The thread holds the device: drivers want it to be gone before the process is.
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
                        "the device has not answered for {} s: its driver hangs, start anew",
                        LONGEST_WAIT.as_secs()
                    )),
                    Err(e) => faults.note(format!("waiting for the device: {e}")),
                }
                // Where another thread has polled too, its callbacks come a little later.
                let end = Instant::now() + MOST_PATIENCE;
                while answer.given().is_none() && faults.check().is_ok() && Instant::now() < end {
                    thread::sleep(Duration::from_millis(1));
                }
            }
            answer.give(false);
        }
    }
}
