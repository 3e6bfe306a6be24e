//! Ctrl-C: the first asks the fit to stop where it can be resumed, a later one quits at once.

use std::{
    sync::{Arc, OnceLock},
    time::{Duration, Instant},
};

use crate::{failure, fit::progress::Voice, output};

/// Signals that come within this time of the first are the same request: `timeout` signals the process and then its whole group.
const SAME_REQUEST: Duration = Duration::from_secs(1);

/// Whether Ctrl-C was pressed, and when first.
#[derive(Debug, Clone, Default)]
pub(crate) struct Interrupt(Arc<OnceLock<Instant>>);

/// What a signal asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Request {
    /// To stop where the work can be resumed.
    Stop,
    /// What has been asked for already.
    Repeated,
    /// To quit at once.
    Quit,
}

impl Interrupt {
    /// Listens for Ctrl-C (and, where the system has them, a polite kill and a closed terminal) from now on; `voice` answers.
    pub(crate) fn listen(voice: Voice) -> Self {
        let interrupt = Self::default();
        let pressed = interrupt.clone();
        let listening = ctrlc::set_handler(move || match pressed.hear(Instant::now()) {
            Request::Stop => {
                voice.say(
                    "stopping at the next step that can be resumed; Ctrl-C again, after a second or more, quits at once",
                );
            }
            Request::Repeated => {}
            Request::Quit => {
                voice.clear();
                failure::quit_now();
            }
        });
        if let Err(error) = listening {
            output::note(format_args!("note: Ctrl-C will not save a checkpoint: {error}"));
        }
        interrupt
    }

    /// Whether the fit was asked to stop.
    pub(crate) fn requested(&self) -> bool {
        self.0.get().is_some()
    }

    /// What a signal asks for that comes now.
    fn hear(&self, now: Instant) -> Request {
        match self.0.get() {
            // Signals are handled one after the other.
            None => {
                self.0.get_or_init(|| now);
                Request::Stop
            }
            Some(first) if now.duration_since(*first) < SAME_REQUEST => Request::Repeated,
            Some(_) => Request::Quit,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signals_in_quick_succession_are_one_request() {
        let (interrupt, first) = (Interrupt::default(), Instant::now());
        let after = |ms| interrupt.hear(first + Duration::from_millis(ms));
        assert!(!interrupt.requested());
        assert_eq!(
            [after(0), after(1), after(900), after(1100)],
            [Request::Stop, Request::Repeated, Request::Repeated, Request::Quit]
        );
        assert!(interrupt.requested());
    }
}
