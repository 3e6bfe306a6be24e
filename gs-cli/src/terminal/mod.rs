//! What a person sees and does while a command runs: notes, progress, Ctrl-C.

pub(crate) mod interrupt;
pub(crate) mod output;
pub(crate) mod progress_bar;
pub(crate) mod stages;
