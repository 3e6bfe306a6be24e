#![doc = include_str!("../README.md")]
//! # Waiting
//!
//! Nothing here blocks: what waits for the device is a future. On native platforms, a thread of the
//! device polls it while a future is pending; in a browser, the browser does.
//!
//! # Limits
//!
//! Every order, blend and statistic is supported. The smooth cut, and for 3D scenes the
//! parameterization `CovarianceFactor` and solving for colours, are an
//! [`Error::Unsupported`](gs_core::Error::Unsupported).
//!
//! Each array is one buffer, whose size adapters bound: GPUs at 2 GiB or more, Mesa's software
//! driver at 128 MiB. The largest array per Gaussian is that of the SH coefficients, and each of
//! Adam's moments of those: 192 bytes at degree 3, so 699,050 Gaussians fit in 128 MiB and 11
//! million in 2 GiB. The largest per tile entry (one per Gaussian and tile of 16×16 px) takes 8
//! bytes for drawing (64 with per-pixel order) and 32 to 44 bytes for training (72 to 88), so 3 to
//! 4 million entries fit in 128 MiB. A scene that does not fit is an
//! [`Error::Backend`](gs_core::Error::Backend) with both sizes. Moments and gradients are allocated
//! when a scene is first trained, so drawing takes a third of the memory.
//!
//! # Inside
//!
//! Each stage is one WGSL file in `shaders/`; `workspace.rs` has their order and their buffers.
//! Reductions have a fixed order or add integers.

mod adapter;
mod answer;
mod blend;
mod collect;
mod dispatch;
mod fault;
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

pub use wgpu;

pub use crate::{
    adapter::{AdapterSummary, adapters},
    forward_pass::{ForwardPass, Gradients},
    gpu::WgpuSettings,
    in_flight::STEPS_IN_FLIGHT,
    rasterizer::WgpuRasterizer,
    shaders::Kernels,
    splats::Splats,
    target::Target,
};
