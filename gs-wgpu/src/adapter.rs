//! The adapters of a machine, and the choice of an adapter and its kernels.

use std::fmt;

use gs_core::Error;
use serde::Serialize;

use crate::{fault::backend_error, shaders::Kernels};

/// What is said of a machine without adapters, with advice.
#[cfg(not(target_family = "wasm"))]
const NONE: &str = "no adapter was found (looked for Vulkan, Metal and DirectX 12): install a graphics driver with Vulkan, \
                    Metal or DirectX 12; without a GPU, a software one will do (Debian and Ubuntu: apt-get install \
                    mesa-vulkan-drivers)";
#[cfg(target_family = "wasm")]
const NONE: &str = "this browser offers no WebGPU: it needs a recent browser that may use graphics acceleration, and a \
                    page from https, from localhost or from a file";

/// Smallest subgroup for which `blend_bwd.wgsl` has enough work-group memory, invocations.
const LEAST_SUBGROUP: u32 = 4;

/// An adapter of this machine.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct AdapterSummary {
    /// The adapter's name, by which [`WgpuSettings::adapter`](crate::WgpuSettings::adapter) finds
    /// it.
    pub name: String,
    /// "discrete GPU", "integrated GPU", "virtual GPU", "CPU" (a software driver) or "other".
    pub kind: &'static str,
    /// The interface: "vulkan", "metal", "dx12".
    pub interface: String,
    /// The driver and its version.
    pub driver: String,
}

impl fmt::Display for AdapterSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({}, {}, {})", self.name, self.kind, self.interface, self.driver)
    }
}

fn instance() -> wgpu::Instance {
    // Not OpenGL: it takes minutes to compile the shaders, and runs them slowly.
    let backends =
        wgpu::Backends::VULKAN | wgpu::Backends::METAL | wgpu::Backends::DX12 | wgpu::Backends::BROWSER_WEBGPU;
    let defaults = wgpu::InstanceDescriptor::new_without_display_handle();
    // `sizes.wgsl` keeps the sizes of indirect dispatches within limits. wgpu's validation would
    // add a dispatch to each.
    let flags = defaults.flags.difference(wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL);
    let descriptor = wgpu::InstanceDescriptor { backends, flags, ..defaults };
    wgpu::Instance::new(descriptor)
}

pub(crate) fn summary_of(info: &wgpu::AdapterInfo) -> AdapterSummary {
    let kind = match info.device_type {
        wgpu::DeviceType::DiscreteGpu => "discrete GPU",
        wgpu::DeviceType::IntegratedGpu => "integrated GPU",
        wgpu::DeviceType::VirtualGpu => "virtual GPU",
        wgpu::DeviceType::Cpu => "CPU",
        wgpu::DeviceType::Other => "other",
    };
    let driver = [info.driver.as_str(), info.driver_info.as_str()].join(" ").trim().to_owned();
    AdapterSummary { name: info.name.clone(), kind, interface: info.backend.to_str().to_owned(), driver }
}

/// The order of preference of adapters: GPUs before software drivers.
fn rank(info: &wgpu::AdapterInfo) -> u32 {
    match info.device_type {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    }
}

/// The limits that a device must have.
pub(crate) fn least_limits() -> wgpu::Limits {
    wgpu::Limits::default()
}

async fn found(instance: &wgpu::Instance) -> Vec<wgpu::Adapter> {
    let mut adapters = instance.enumerate_adapters(wgpu::Backends::all()).await;
    adapters.sort_by_key(|a| rank(&a.get_info()));
    adapters
}

/// The adapters of this machine. The first one is the default.
pub async fn adapters() -> Vec<AdapterSummary> {
    found(&instance()).await.iter().map(|a| summary_of(&a.get_info())).collect()
}

/// The adapter whose name contains `wanted`, or the fastest kind, and the reason of the choice.
pub(crate) async fn choose(wanted: Option<&str>) -> Result<(wgpu::Adapter, String), Error> {
    let mut adapters = found(&instance()).await;
    let (index, reason) = match wanted {
        _ if adapters.is_empty() => return Err(backend_error(NONE)),
        None => (0, choice_reason(&adapters)),
        Some(wanted) => {
            let matches = |a: &wgpu::Adapter| a.get_info().name.to_lowercase().contains(&wanted.to_lowercase());
            let index = adapters.iter().position(matches).ok_or_else(|| {
                let names: Vec<String> = adapters.iter().map(|a| a.get_info().name).collect();
                backend_error(format!("no adapter's name contains \"{wanted}\"; found: {}", names.join(", ")))
            })?;
            (index, format!("its name contains \"{wanted}\""))
        }
    };
    Ok((adapters.swap_remove(index), reason))
}

fn choice_reason(adapters: &[wgpu::Adapter]) -> String {
    match adapters {
        [_] => "the only adapter".to_owned(),
        [first, ..] if first.get_info().device_type == wgpu::DeviceType::Cpu => "no GPU was found".to_owned(),
        _ => format!("the fastest kind of {} adapters", adapters.len()),
    }
}

/// The requested kernels, or the fastest.
pub(crate) fn kernels(
    wanted: Option<Kernels>,
    info: &wgpu::AdapterInfo,
    features: wgpu::Features,
) -> Result<Kernels, Error> {
    let subgroups = features.contains(wgpu::Features::SUBGROUP) && info.subgroup_min_size >= LEAST_SUBGROUP;
    match wanted {
        None if subgroups => Ok(Kernels::Subgroups),
        None | Some(Kernels::Portable) => Ok(Kernels::Portable),
        Some(Kernels::Subgroups) if subgroups => Ok(Kernels::Subgroups),
        Some(Kernels::Subgroups) => Err(backend_error(format!(
            "{} has no Subgroups kernels: they need subgroups of {LEAST_SUBGROUP} or more",
            info.name
        ))),
    }
}
