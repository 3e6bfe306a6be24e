//! 3D scenes: images, effects, gradients and determinism.

mod effects;
mod gradients;
mod images;
mod moments;
mod scenes;
mod threads;
