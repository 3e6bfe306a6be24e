//! Scenes, views and settings made of bytes, so that a fuzzer can draw them, and what any backend owes them, however hostile they are.
//!
//! Ordinary numbers are mixed with those that break arithmetic: zeros, subnormal numbers, the largest there are, NaN. What is right is not
//! known from outside, as the oracle knows it of tame scenes; what is always wrong is: a panic, a pixel that no mixture of the colours
//! can give, the same frame twice with different bits, gradients or a training that are not finite though all that they are made of is
//! moderate, a scene or a view accepted that is none.

mod bytes;
mod draw;
mod owed;

pub use self::{
    draw::{Fuzzed, scene_2d, scene_3d},
    owed::{Bounded, image_is_sound, owes},
};
