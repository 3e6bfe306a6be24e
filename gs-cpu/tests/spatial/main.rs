//! Spatial scenes on the CPU: images, gradients, reproducibility, edits and state, and scenes that mean harm.

mod gradients;
mod hostile;
mod images;
mod scenes;
mod state;
mod threads;
