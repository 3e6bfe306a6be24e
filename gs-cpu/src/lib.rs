#![doc = include_str!("../README.md")]
//! # Inside
//!
//! Images are stored in strips of 16 columns, so one vector register holds one row of a strip; a
//! tile is a band of a strip. Each stage has a file of its name: `bin`, `blend_sum` and
//! `blend_over` (forward and backward), `loss` and `dssim` serve every kind of scene, `project`,
//! `project_bwd` and `adam` are in `scene2d` and `scene3d`. Every reduction has a fixed order.
//!
//! [`CpuRasterizer`] implements [`Rasterizer`](gs_core::Rasterizer) and
//! [`Optimizer`](gs_core::Optimizer).

// Guards are phrased so that NaN fails them: `!(x > 0.0)` is not `x <= 0.0`.
#![allow(clippy::neg_cmp_op_on_partial_ord)]
#![forbid(unsafe_code)]

mod at_pixel;
mod bias;
mod bin;
mod blend_over;
mod blend_per_pixel;
mod blend_sum;
mod collect;
mod draw;
mod dssim;
mod forward_pass;
mod kind;
mod lanes;
mod layout;
mod level;
mod loss;
mod pointwise;
mod profile;
mod rasterizer;
mod rows;
mod scene2d;
mod scene3d;
mod scratches;
mod slots;
mod splat;
mod stage;
mod target;
mod tile_inputs;
mod tiles;
mod unsupported;
mod workspace;

pub use forward_pass::{ForwardPass, Gradients};
pub use level::SimdLevel;
pub use rasterizer::{CpuRasterizer, CpuSettings};
pub use scene2d::Splats2d;
pub use scene3d::Splats3d;
pub use target::Target;
