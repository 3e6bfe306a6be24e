//! The [`Rasterizer`](gs_core::Rasterizer) on any GPU that wgpu reaches: Vulkan, Metal and DirectX 12, a software driver included.
//!
//! Every stage is one WGSL file of `shaders/`; `workspace.rs` says in which order they run, on which buffers. All state stays on the device,
//! and reductions have a fixed order, so one adapter repeats itself bit for bit.
//!
//! ```no_run
//! use gs_core::{Blend, Canvas, PlanarScene, Rasterizer, RenderSettings};
//! use gs_wgpu::{WgpuRasterizer, WgpuSettings};
//!
//! # fn main() -> Result<(), gs_core::Error> {
//! let wgpu = WgpuRasterizer::new(WgpuSettings::default())?;
//! let image = wgpu.render(&PlanarScene::default(), &Canvas::new(64, 48), &RenderSettings::blended(Blend::Sum))?;
//! # Ok(()) }
//! ```

mod cloud;
mod dispatch;
mod frame;
mod gpu;
mod in_flight;
mod layout;
mod profile;
mod rasterizer;
mod shaders;
mod target;
mod timestamps;
mod traffic;
mod workspace;

pub use crate::{
    cloud::PlanarCloud,
    frame::{PlanarFrame, PlanarGradients},
    gpu::{AdapterSummary, FreshBuffers, WgpuSettings, adapters},
    in_flight::STEPS_IN_FLIGHT,
    rasterizer::WgpuRasterizer,
    shaders::Kernels,
    target::PlanarTarget,
};
