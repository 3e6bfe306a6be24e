//! The training loop: initialisers, schedules, density control, observers and checkpoints.
