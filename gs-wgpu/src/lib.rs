//! The [`Rasterizer`](gs_core::Rasterizer) on any GPU that wgpu reaches: Vulkan, Metal and DirectX 12, a software driver included.
//!
//! Every stage is one WGSL file of `shaders/`; `workspace.rs` says in which order they run, on which buffers. All state stays on the device,
//! and reductions have a fixed order, or are of integers, so one adapter repeats itself bit for bit.
//!
//! Every order, blend and statistic is offered. What is not, is an [`Error::Unsupported`](gs_core::Error::Unsupported) that names
//! it: the smooth cut, extents in standard deviations, and for 3D scenes the parameterization `CovarianceFactor` and solving for colours.
//!
//! # How large a scene may be
//!
//! Each array is one buffer, and adapters bound how large one is: GPUs at 2 GiB or more, Mesa's software driver at 128 MiB. The largest by Gaussian is
//! that of the SH coefficients, and each of Adam's moments of those: 192 bytes at degree 3, so 699,050 Gaussians in 128 MiB and 11 million in 2 GiB.
//! The largest by tile entry (one per Gaussian and tile of 16×16 px) has 8 bytes where a scene is drawn (64 in the order of depth at each pixel), and
//! 32 to 44 where it is trained (72 to 88), so 3 to 4 million entries in 128 MiB. What does not fit is an [`Error::Backend`](gs_core::Error::Backend)
//! with both sizes. Moments and gradients are made when a scene is first trained: to look at one takes a third of the memory.
//!
//! Nothing here blocks: what waits for the device is a future. On native platforms a thread of the device's own polls it while a future is
//! pending; in a browser, the browser does. A program that wants to wait does so with an executor, for instance that of `pollster`:
//!
//! ```no_run
//! use gs_core::{Blend, Canvas, Scene2d, Rasterizer, RenderSettings};
//! use gs_wgpu::{WgpuRasterizer, WgpuSettings};
//!
//! # fn main() -> Result<(), gs_core::Error> {
//! pollster::block_on(async {
//!     let wgpu = WgpuRasterizer::new(WgpuSettings::default()).await?;
//!     let settings = RenderSettings::blended(Blend::Sum);
//!     let image = wgpu.render(&Scene2d::default(), &Canvas::new(64, 48), &settings).await?;
//!     Ok(())
//! })
//! # }
//! ```

mod adapter;
mod answer;
mod blend;
mod collect;
mod dispatch;
mod forward_pass;
mod gpu;
mod in_flight;
mod kind;
mod layout;
mod lists;
mod loop_limit;
mod loss;
mod profile;
mod rasterizer;
mod scene2d;
mod scene3d;
mod shaders;
mod show;
mod splats;
mod target;
mod tiles;
mod timestamps;
mod workspace;

use gs_core::{Scene2d, Scene3d};
pub use wgpu;

pub use crate::{
    adapter::{AdapterSummary, adapters},
    forward_pass::{ForwardPass, Gradients},
    gpu::WgpuSettings,
    in_flight::STEPS_IN_FLIGHT,
    kind::SceneKind,
    rasterizer::WgpuRasterizer,
    shaders::Kernels,
    splats::Splats,
    target::Target,
};

#[cfg(feature = "test-hooks")]
pub use crate::gpu::FreshBuffers;

/// 2D Gaussians on a device.
pub type Splats2d = Splats<Scene2d>;

/// 3D Gaussians on a device.
pub type Splats3d = Splats<Scene3d>;

/// A forward pass of a 2D scene.
pub type ForwardPass2d = ForwardPass<Scene2d>;

/// A forward pass of a 3D scene.
pub type ForwardPass3d = ForwardPass<Scene3d>;

/// The gradients of a 2D scene.
pub type Gradients2d = Gradients<Scene2d>;

/// The gradients of a 3D scene.
pub type Gradients3d = Gradients<Scene3d>;
