//! Ctrl-C: the first asks the fit to stop where it can be resumed, the second quits at once.

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};

use crate::{failure, fit::progress::Voice, output};

/// Whether Ctrl-C was pressed.
#[derive(Debug, Clone, Default)]
pub(crate) struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Listens for Ctrl-C (and, where the system has them, a polite kill and a closed terminal) from now on; `voice` answers.
    pub(crate) fn listen(voice: Voice) -> Self {
        let interrupt = Self::default();
        let pressed = interrupt.clone();
        let listening = ctrlc::set_handler(move || {
            if pressed.0.swap(true, Ordering::Relaxed) {
                voice.clear();
                failure::quit_now();
            }
            voice.say("stopping at the next step that can be resumed; Ctrl-C again quits at once");
        });
        if let Err(error) = listening {
            output::note(format_args!("note: Ctrl-C will not save a checkpoint: {error}"));
        }
        interrupt
    }

    /// Whether the fit was asked to stop.
    pub(crate) fn requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
