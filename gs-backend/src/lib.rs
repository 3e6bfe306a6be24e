//! The backend chosen at run time.
//!
//! [`AnyRasterizer`] is a rasterizer of gs-cpu or of gs-wgpu behind one type, for programs that choose when they start. [`open`] chooses:
//! the GPU where there is one, the processor otherwise, and says why.
//!
//! [`block_on`] waits for a future. It is for programs that have nothing else to do; a page or a server awaits instead.
//!
//! ```
//! use gs_backend::{Request, block_on, open};
//! use gs_core::{Canvas, Rasterizer, RenderSettings, Scene2d};
//!
//! # fn main() -> Result<(), gs_core::Error> {
//! let chosen = block_on(open(&Request::default()))?;
//! println!("{}", chosen.reason);
//! let view = Canvas::new(64, 48);
//! let image = block_on(chosen.rasterizer.render(&Scene2d::default(), &view, &RenderSettings::default()))?;
//! assert_eq!(image.size(), (64, 48));
//! # Ok(()) }
//! ```
//!
//! The features `cpu` and `wgpu`, both on by default, say which backends a build has.

mod any;
mod choice;
mod gpu;

pub use any::{AnyForwardPass, AnyGradients, AnyOf, AnyRasterizer, AnySplats, AnyTarget};
pub use choice::{Chosen, Request, Wanted, open, open_for};
pub use gpu::may_have_gpu;
pub use pollster::{FutureExt, block_on};
