//! The [`Rasterizer`](gs_core::Rasterizer) on the CPU: rayon across tiles, explicit SIMD inside them, no `unsafe`.
//!
//! The image is held in strips of 16 columns (`layout`), so that one vector register is one row of a strip, and a tile is a band of
//! a strip's rows. The stages stand in files of their names: `bin`, `blend_sum` and `blend_over` (forward and backward), `loss`, `dssim`,
//! which are the same for every kind of scene (`tiles`); `project`, `sort`, `project_bwd`, `adam` in `2D` and `3D`. Everything is reduced in a fixed order: images, gradients and training
//! runs are bit-identical for every number of threads. Levels of SIMD differ from each other by rounding only.

// Guards are phrased so that NaN fails them: `!(x > 0.0)` is not `x <= 0.0`.
#![allow(clippy::neg_cmp_op_on_partial_ord)]
#![forbid(unsafe_code)]

mod bias;
mod bin;
mod blend_over;
mod blend_per_pixel;
mod blend_sum;
mod collect;
mod draw;
mod dssim;
mod kind;
mod lanes;
mod layout;
mod level;
mod loss;
mod profile;
mod rasterizer;
mod scene2d;
mod scene3d;
mod scratches;
mod splat;
mod tiles;
mod tuning;
mod workspace;

pub use kind::SceneKind;
pub use level::SimdLevel;
pub use loss::Target;
pub use rasterizer::{CpuRasterizer, CpuSettings};
pub use scene2d::Splats2d;
pub use scene3d::Splats3d;
pub use tuning::{Bounds, CpuTuning};
pub use workspace::{ForwardPass, ForwardPass2d, ForwardPass3d, Gradients, Gradients2d, Gradients3d};
