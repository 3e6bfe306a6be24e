//! 3D scenes on the CPU: images, effects, gradients, reproducibility, edits and state, and scenes that mean harm.

mod effects;
mod gradients;
mod hostile;
mod images;
mod scenes;
mod state;
mod threads;
