//! Ctrl-C: the first asks the work to stop where it can be resumed, a later one quits at once.

use std::{
    sync::{Arc, Mutex, OnceLock, PoisonError},
    time::{Duration, Instant},
};

use super::{output, progress_bar::Printer};
use crate::failure;

/// Signals within this time of the first are the same request: `timeout` signals the process and
/// then its whole group.
const SAME_REQUEST: Duration = Duration::from_secs(1);

/// Whether Ctrl-C was pressed, and when first.
#[derive(Debug, Clone, Default)]
pub(crate) struct Interrupt {
    first: Arc<OnceLock<Instant>>,
}

/// Message for runs that stop at their next checkpoint.
pub(crate) const AT_NEXT_STEP: &str = "stopping at the next step that can be resumed";

/// What a signal asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Request {
    /// Stop where the work can be resumed.
    Stop,
    /// Nothing new: the signal repeats the one before.
    Repeated,
    /// Quit at once.
    Quit,
}

impl Interrupt {
    /// Listens for Ctrl-C from now on and, where the system has them, for a polite kill and a
    /// closed terminal. The first prints how the work ends: "stopping after this image".
    pub(crate) fn listen(printer: Printer, how: &'static str) -> Self {
        let interrupt = Self::default();
        let pressed = interrupt.clone();
        handle(move || match pressed.receive(Instant::now()) {
            Request::Stop => {
                printer.print(format_args!("{how}; Ctrl-C again, after a second or more, quits at once"));
            }
            Request::Repeated => {}
            Request::Quit => {
                printer.clear_bar();
                failure::quit_now();
            }
        });
        interrupt
    }

    /// Whether the work was asked to stop.
    pub(crate) fn requested(&self) -> bool {
        self.first.get().is_some()
    }

    /// The request of a signal that comes at this time.
    fn receive(&self, now: Instant) -> Request {
        match self.first.get() {
            // Signals are handled one after the other.
            None => {
                self.first.get_or_init(|| now);
                Request::Stop
            }
            Some(first) if now.duration_since(*first) < SAME_REQUEST => Request::Repeated,
            Some(_) => Request::Quit,
        }
    }
}

/// What a signal does, as the part of the command that listened last has it.
static HANDLER: Mutex<Option<Box<dyn FnMut() + Send>>> = Mutex::new(None);

fn handle(handler: impl FnMut() + Send + 'static) {
    let lock = || HANDLER.lock().unwrap_or_else(PoisonError::into_inner);
    if lock().replace(Box::new(handler)).is_some() {
        return;
    }
    let call = move || lock().iter_mut().for_each(|handler| handler());
    if let Err(error) = ctrlc::set_handler(call) {
        output::note(format_args!("note: Ctrl-C will end the program at once, without saving anything: {error}"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signals_in_quick_succession_are_one_request() {
        let (interrupt, first) = (Interrupt::default(), Instant::now());
        let after = |ms| interrupt.receive(first + Duration::from_millis(ms));
        assert!(!interrupt.requested());
        assert_eq!(
            [after(0), after(1), after(900), after(1100)],
            [Request::Stop, Request::Repeated, Request::Repeated, Request::Quit]
        );
        assert!(interrupt.requested());
    }
}
