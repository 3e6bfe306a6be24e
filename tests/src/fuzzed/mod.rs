//! Scenes, views and settings from bytes, for a fuzzer, and what any backend must do with them.
//!
//! Ordinary numbers are mixed with hostile ones: zeros, subnormal numbers, the largest numbers,
//! NaN. There is no reference for such scenes, but some outcomes are always wrong: a panic; a pixel
//! that no mixture of the colours can give; different bits for the same forward pass; gradients or
//! parameters that are not finite although all inputs are moderate; an invalid scene or view that
//! is accepted.

mod bytes;
mod draw;
mod requirements;

pub use self::{
    draw::{Fuzzed, scene_2d, scene_3d},
    requirements::{Bounded, check_backend, image_is_sound},
};
