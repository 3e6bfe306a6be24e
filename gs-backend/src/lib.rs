#![doc = include_str!("../README.md")]

#[cfg(not(any(feature = "cpu", feature = "wgpu")))]
compile_error!("gs-backend needs a backend: enable its feature `cpu`, `wgpu` or both");

mod any;
mod choice;
#[cfg(feature = "wgpu")]
mod gpu;
mod threads;

pub use any::{AnyForwardPass, AnyGradients, AnyOf, AnyRasterizer, AnySplats, AnyTarget};
pub use choice::{Chosen, Request, Wanted, can_render_2d, open, open_for};
pub use pollster::{FutureExt, block_on};
pub use threads::host_threads;
