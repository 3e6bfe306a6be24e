#![doc = include_str!("../README.md")]

mod any;
mod choice;
mod gpu;

pub use any::{AnyForwardPass, AnyGradients, AnyOf, AnyRasterizer, AnySplats, AnyTarget};
pub use choice::{Chosen, Request, Wanted, open, open_for};
pub use gpu::may_have_gpu;
pub use pollster::{FutureExt, block_on};
