//! Spatial scenes on the CPU: gradients, reproducibility, edits and state, and scenes that mean harm.

mod gradients;
mod hostile;
mod scenes;
mod state;
mod threads;
