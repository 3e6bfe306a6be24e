//! Which backend computes, and why.

use gs_core::{Backend, Canvas, Error, Rasterizer, RenderSettings, Scene2d};
#[cfg(feature = "cpu")]
use gs_cpu::{CpuRasterizer, CpuSettings, SimdLevel};
#[cfg(feature = "wgpu")]
use gs_wgpu::{WgpuRasterizer, WgpuSettings};

use crate::{AnyRasterizer, threads::Threads};

gs_core::choices! {
    /// Which backend is wanted.
    #[derive(Default)]
    pub enum Wanted {
        /// A suitable GPU if there is one, otherwise the CPU.
        #[default]
        Fastest = "auto": "A GPU if this machine has one, otherwise the CPU",
        /// The CPU.
        Cpu = "cpu": "The CPU, with all its cores and its widest SIMD level",
        /// The adapter that [`WgpuSettings`](gs_wgpu::WgpuSettings) name, or the first.
        Wgpu = "wgpu": "Any GPU through Vulkan, Metal or DirectX 12, or a software driver",
    }
}

/// A request for a backend.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct Request {
    /// Which backend.
    pub wanted: Wanted,
    /// Why this backend is wanted, for [`Chosen::reason`]; "as requested" unless something else is
    /// given.
    pub why: Option<&'static str>,
    /// Threads on the host, at least 1. The default is `RAYON_NUM_THREADS`, or one per core.
    pub threads: Option<usize>,
    /// SIMD level of the CPU backend. The default is the fastest of this machine.
    #[cfg(feature = "cpu")]
    pub level: Option<SimdLevel>,
    /// Adapter and kernels of the wgpu backend. Under [`Wanted::Fastest`] they are ignored.
    #[cfg(feature = "wgpu")]
    pub wgpu: WgpuSettings,
}

gs_core::impl_with!(Request);

impl Request {
    fn why(&self) -> &'static str {
        self.why.unwrap_or("as requested")
    }
}

/// A backend that is ready to compute, and why it was chosen.
#[derive(Debug)]
pub struct Chosen {
    /// The backend.
    pub rasterizer: AnyRasterizer,
    /// Why this backend was chosen: "no GPU was found".
    pub why: String,
    /// What was chosen and why, in one line: "cpu (avx2, 2 threads): no GPU was found, …".
    pub reason: String,
    /// Threads on the host. The CPU backend computes with them; with a GPU they are for everything
    /// else.
    pub threads: usize,
}

/// Opens the requested backend.
///
/// # Errors
/// [`Error::Setting`] for impossible threads or a SIMD level that this machine lacks,
/// [`Error::Backend`] where there is no such adapter, it gives no device, or this build lacks the
/// backend.
pub async fn open(request: &Request) -> Result<Chosen, Error> {
    open_for(request, async |_: &AnyRasterizer| Ok(())).await
}

/// Opens the requested backend. Under [`Wanted::Fastest`], a GPU for which `suits` returns an error
/// is not used.
///
/// [`can_render_2d`] is such a check.
///
/// # Errors
/// Those of [`open`].
pub async fn open_for(
    request: &Request,
    suits: impl AsyncFnOnce(&AnyRasterizer) -> Result<(), Error>,
) -> Result<Chosen, Error> {
    let threads = Threads::choose(request.threads)?;
    match request.wanted {
        Wanted::Cpu => cpu(request, &threads, request.why()),
        Wanted::Wgpu => {
            let (rasterizer, why) = wgpu(request).await?;
            Ok(on_gpu(rasterizer, request.why(), &why, &threads))
        }
        Wanted::Fastest => match gpu(request, suits).await {
            Ok((rasterizer, why)) => Ok(on_gpu(rasterizer, "a GPU was found", &why, &threads)),
            Err(why) => cpu(request, &threads, &why),
        },
    }
}

/// Checks whether a backend offers what rendering 2D scenes with these settings needs.
///
/// # Errors
/// Those of [`Rasterizer::forward`].
pub async fn can_render_2d(rasterizer: &AnyRasterizer, settings: &RenderSettings) -> Result<(), Error> {
    rasterizer.for_2d().render(&Scene2d::default(), &Canvas::new(1, 1), settings).await.map(drop)
}

fn on_gpu(rasterizer: AnyRasterizer, why: &str, why_adapter: &str, threads: &Threads) -> Chosen {
    let why = format!("{why}, {why_adapter}");
    let reason = format!("{}: {why}, {} for seeding", rasterizer.describe(), threads.why);
    Chosen { rasterizer, why, reason, threads: threads.count }
}

#[cfg(any(not(feature = "cpu"), not(feature = "wgpu")))]
fn not_in_this_build(backend: &'static str) -> Error {
    Error::Backend { backend, message: "this build lacks this backend".to_owned() }
}

#[cfg(feature = "cpu")]
fn cpu(request: &Request, threads: &Threads, why: &str) -> Result<Chosen, Error> {
    let settings = CpuSettings::default().with(|s| {
        s.threads = Some(threads.count);
        s.level = request.level;
    });
    let rasterizer = CpuRasterizer::new(settings)?;
    let why_level = match request.level {
        Some(_) => "SIMD level as requested",
        None => "the fastest SIMD level of this machine",
    };
    let reason = format!("{}: {why}, {why_level}, {}", rasterizer.describe(), threads.why);
    let (rasterizer, why) = (AnyRasterizer::Cpu(Box::new(rasterizer)), why.to_owned());
    Ok(Chosen { rasterizer, why, reason, threads: threads.count })
}

#[cfg(not(feature = "cpu"))]
fn cpu(_: &Request, _: &Threads, _: &str) -> Result<Chosen, Error> {
    Err(not_in_this_build("cpu"))
}

/// The adapter that the request names, and why it was taken.
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

/// A suitable GPU and why this one, or why there is none.
#[cfg(feature = "wgpu")]
async fn gpu(
    request: &Request,
    suits: impl AsyncFnOnce(&AnyRasterizer) -> Result<(), Error>,
) -> Result<(AnyRasterizer, String), String> {
    let none = "no GPU was found";
    if !crate::gpu::may_have_gpu(std::path::Path::new("/dev")) {
        return Err(none.to_owned());
    }
    let mut settings = request.wgpu.clone();
    (settings.adapter, settings.kernels) = (None, None);
    let rasterizer = match WgpuRasterizer::new(settings).await {
        Ok(found) => found,
        Err(Error::Backend { message, .. }) => return Err(format!("no GPU can be used ({message})")),
        Err(error) => return Err(format!("no GPU can be used ({error})")),
    };
    // A driver that computes on the CPU is slower than the CPU backend. Adapters are ranked, so
    // that if the first is one, all are.
    if rasterizer.adapter().kind == "CPU" {
        return Err(format!("{none}, only a software driver ({})", rasterizer.adapter().name));
    }
    if_suitable(rasterizer, suits).await
}

#[cfg(feature = "wgpu")]
async fn if_suitable(
    rasterizer: WgpuRasterizer,
    suits: impl AsyncFnOnce(&AnyRasterizer) -> Result<(), Error>,
) -> Result<(AnyRasterizer, String), String> {
    let (name, why) = (rasterizer.adapter().name.clone(), rasterizer.reason().to_owned());
    let rasterizer = AnyRasterizer::Wgpu(Box::new(rasterizer));
    match suits(&rasterizer).await {
        Ok(()) => Ok((rasterizer, why)),
        Err(error) => Err(format!("the GPU {name} is not used, as {error}")),
    }
}

#[cfg(not(feature = "wgpu"))]
async fn gpu(
    _: &Request,
    _: impl AsyncFnOnce(&AnyRasterizer) -> Result<(), Error>,
) -> Result<(AnyRasterizer, String), String> {
    Err("this build lacks the wgpu backend".to_owned())
}

#[cfg(all(test, feature = "wgpu"))]
mod tests {
    use gs_core::Cut;
    use pollster::FutureExt as _;

    use super::*;

    /// The tests' software driver stands in for a GPU.
    fn why_not(suits: impl AsyncFnOnce(&AnyRasterizer) -> Result<(), Error>) -> Option<String> {
        let gpu = WgpuRasterizer::new(WgpuSettings::default()).block_on();
        if_suitable(gpu.expect("`cargo xtask test` installs a driver"), suits).block_on().err()
    }

    #[test]
    fn wgpu_without_an_effect_is_not_used() {
        let with = |cut| {
            let mut settings = RenderSettings::default();
            settings.accuracy.cut = cut;
            why_not(async move |gpu| can_render_2d(gpu, &settings).await)
        };
        assert_eq!(with(Cut::Hard), None);
        let why = with(Cut::Smooth).unwrap();
        assert!(why.starts_with("the GPU ") && why.contains("does not offer a smooth cut"), "{why}");
    }
}
