//! The [`Rasterizer`](gs_core::Rasterizer) on the CPU: rayon across tiles, explicit SIMD inside them, no `unsafe`.
//!
//! The image is held in strips of 16 columns (`layout`), so that one vector register is one row of a strip, and a tile is a band of
//! a strip's rows. The stages stand in files of their names: `project`, `bin`, `blend_sum` and `blend_over` (forward and
//! backward), `loss`, `dssim`, `project_bwd`, `adam`. Everything is reduced in a fixed order: images, gradients and training
//! runs are bit-identical for every number of threads. Levels of SIMD differ from each other by rounding only.

// Guards are phrased so that NaN fails them: `!(x > 0.0)` is not `x <= 0.0`.
#![allow(clippy::neg_cmp_op_on_partial_ord)]
#![forbid(unsafe_code)]

mod adam;
mod bin;
mod blend_over;
mod blend_sum;
mod cloud;
mod collect;
mod dssim;
mod lanes;
mod layout;
mod level;
mod loss;
mod profile;
mod project;
mod project_bwd;
mod rasterizer;
mod solve_colors;
mod traffic;
mod workspace;

pub use cloud::PlanarCloud;
pub use level::SimdLevel;
pub use loss::PlanarTarget;
pub use project_bwd::PlanarGradients;
pub use rasterizer::{CpuRasterizer, CpuSettings};
pub use workspace::PlanarFrame;
