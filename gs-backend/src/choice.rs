//! Which backend computes, and why.

use gs_core::{Backend, Error};
#[cfg(feature = "cpu")]
use gs_cpu::{CpuRasterizer, CpuSettings, CpuTuning};
#[cfg(feature = "wgpu")]
use gs_wgpu::{WgpuRasterizer, WgpuSettings};

use crate::AnyRasterizer;

/// Which backend is wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Wanted {
    /// A GPU where there is one that suits, the processor otherwise.
    #[default]
    Fastest,
    /// The processor.
    Cpu,
    /// The adapter that [`WgpuSettings`](gs_wgpu::WgpuSettings) name, or the first.
    Wgpu,
}

/// What is wanted of a backend.
#[derive(Debug, Clone, Default)]
pub struct Request {
    /// Which one.
    pub wanted: Wanted,
    /// Threads and SIMD level, where the processor computes.
    #[cfg(feature = "cpu")]
    pub cpu: CpuSettings,
    /// How the processor goes about its work.
    #[cfg(feature = "cpu")]
    pub tuning: CpuTuning,
    /// Adapter and kernels, where a GPU computes.
    #[cfg(feature = "wgpu")]
    pub wgpu: WgpuSettings,
}

/// A backend that is ready to compute, and why it is this one.
#[derive(Debug)]
pub struct Chosen {
    /// The backend.
    pub rasterizer: AnyRasterizer,
    /// What was chosen and why, one line: "cpu (avx2, 2 threads): no GPU was found".
    pub reason: String,
}

/// Opens the backend that is wanted.
///
/// # Errors
/// [`Error::Setting`] for threads or a SIMD level that cannot be, [`Error::Backend`] where there is no such adapter, it gives no device, or
/// this build is without the backend.
pub async fn open(request: &Request) -> Result<Chosen, Error> {
    open_for(request, async |_: &AnyRasterizer| Ok(())).await
}

/// Opens the backend that is wanted; where that is the fastest, a GPU of which `suits` is an error is passed by.
///
/// # Errors
/// As [`open`].
pub async fn open_for(
    request: &Request,
    suits: impl AsyncFnOnce(&AnyRasterizer) -> Result<(), Error>,
) -> Result<Chosen, Error> {
    match request.wanted {
        Wanted::Cpu => cpu(request, "as asked"),
        Wanted::Wgpu => {
            let (rasterizer, why) = wgpu(request).await?;
            Ok(chosen(rasterizer, &format!("as asked, {why}")))
        }
        Wanted::Fastest => match gpu(request, suits).await {
            Ok((rasterizer, why)) => Ok(chosen(rasterizer, &format!("a GPU was found, {why}"))),
            Err(why) => cpu(request, &why),
        },
    }
}

fn chosen(rasterizer: AnyRasterizer, why: &str) -> Chosen {
    Chosen { reason: format!("{}: {why}", rasterizer.describe()), rasterizer }
}

#[cfg(any(not(feature = "cpu"), not(feature = "wgpu")))]
fn not_in_this_build(backend: &'static str) -> Error {
    Error::Backend { backend, message: "this build is without this backend".to_owned() }
}

#[cfg(feature = "cpu")]
fn cpu(request: &Request, why: &str) -> Result<Chosen, Error> {
    let rasterizer = CpuRasterizer::new(request.cpu)?.with_tuning(request.tuning)?;
    Ok(chosen(AnyRasterizer::Cpu(Box::new(rasterizer)), why))
}

#[cfg(not(feature = "cpu"))]
fn cpu(_: &Request, _: &str) -> Result<Chosen, Error> {
    Err(not_in_this_build("cpu"))
}

/// The adapter that the request names, and why it is this one.
#[cfg(feature = "wgpu")]
async fn wgpu(request: &Request) -> Result<(AnyRasterizer, String), Error> {
    let rasterizer = WgpuRasterizer::new(request.wgpu.clone()).await?;
    let why = rasterizer.reason().to_owned();
    Ok((AnyRasterizer::Wgpu(Box::new(rasterizer)), why))
}

#[cfg(not(feature = "wgpu"))]
async fn wgpu(_: &Request) -> Result<(AnyRasterizer, String), Error> {
    Err(not_in_this_build("wgpu"))
}

/// A GPU that suits, and why it is this one; or why there is none.
#[cfg(feature = "wgpu")]
async fn gpu(
    request: &Request,
    suits: impl AsyncFnOnce(&AnyRasterizer) -> Result<(), Error>,
) -> Result<(AnyRasterizer, String), String> {
    let none = "no GPU was found";
    if !crate::may_have_gpu(std::path::Path::new("/dev")) {
        return Err(none.to_owned());
    }
    let (rasterizer, why) = match wgpu(request).await {
        Ok(found) => found,
        Err(Error::Backend { message, .. }) => return Err(format!("no GPU can be used ({message})")),
        Err(error) => return Err(format!("no GPU can be used ({error})")),
    };
    let adapter = match &rasterizer {
        AnyRasterizer::Wgpu(rasterizer) => rasterizer.adapter().clone(),
        #[cfg(feature = "cpu")]
        AnyRasterizer::Cpu(_) => return Err(none.to_owned()),
    };
    // Adapters are ranked, so that if the first is none, no other is.
    if adapter.kind == "CPU" {
        return Err(format!("{none}, only a software driver ({})", adapter.name));
    }
    match suits(&rasterizer).await {
        Ok(()) => Ok((rasterizer, why)),
        Err(error) => Err(format!("the GPU {} is not used, as {error}", adapter.name)),
    }
}

#[cfg(not(feature = "wgpu"))]
async fn gpu(
    _: &Request,
    _: impl AsyncFnOnce(&AnyRasterizer) -> Result<(), Error>,
) -> Result<(AnyRasterizer, String), String> {
    Err("this build is without wgpu".to_owned())
}
