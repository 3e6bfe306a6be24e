//! What renders: backends with their SIMD levels, numbers of threads and kernels, each with
//! the scene uploaded.

use std::{ops::Deref, rc::Rc, time::Instant};

use gs_backend::{AnyRasterizer, FutureExt as _};
use gs_core::{Backend as _, Error, Image, Optimizer, Parameterization, Rasterizer, RenderSettings, Scene};
use gs_cpu::{CpuRasterizer, CpuSettings, SimdLevel};
use gs_wgpu::{Kernels, WgpuRasterizer, WgpuSettings};

use super::frontier::Change;

/// A rasterizer with its scene, independent of its type.
pub(crate) trait Renderer<V> {
    /// Seconds of one forward pass, until the backend has finished it. The image is not read back.
    fn seconds(&self, view: &V, settings: &RenderSettings) -> Result<f64, Error>;

    /// The picture.
    fn image(&self, view: &V, settings: &RenderSettings) -> Result<Image, Error>;
}

/// A rasterizer, owned or borrowed, with an uploaded scene, which several may share.
pub(crate) struct Loaded<P: Deref<Target: Rasterizer<S>>, S: Scene> {
    rasterizer: P,
    splats: Rc<<P::Target as Rasterizer<S>>::Splats>,
}

impl<P: Deref<Target: Rasterizer<S>>, S: Scene> Loaded<P, S> {
    /// Uploads a scene.
    pub(crate) fn new(rasterizer: P, scene: &S) -> Result<Self, Error> {
        let splats = Rc::new(rasterizer.upload(scene, Parameterization::ScaleRotation)?);
        Ok(Self { rasterizer, splats })
    }
}

impl<P: Deref<Target: Rasterizer<S>>, S: Scene> Renderer<S::View> for Loaded<P, S> {
    fn seconds(&self, view: &S::View, settings: &RenderSettings) -> Result<f64, Error> {
        let start = Instant::now();
        let frame = self.rasterizer.forward(&self.splats, view, settings).block_on()?;
        // Reading the counts waits for the device.
        self.rasterizer.culled(&frame);
        Ok(start.elapsed().as_secs_f64())
    }

    fn image(&self, view: &S::View, settings: &RenderSettings) -> Result<Image, Error> {
        self.rasterizer.image(&self.rasterizer.forward(&self.splats, view, settings).block_on()?).block_on()
    }
}

/// A machine that takes part in a comparison.
pub(crate) struct Candidate<'a, V> {
    /// Name of its backend. The first candidate of a backend is the one that the default is measured
    /// on.
    pub(crate) backend: String,
    /// The machine for reports: "cpu (avx512, 2 threads)".
    pub(crate) name: String,
    /// The difference from the first candidate of the same backend; `None` for the first.
    pub(crate) change: Option<Change>,
    /// What renders.
    pub(crate) renderer: Box<dyn Renderer<V> + 'a>,
}

impl<V> std::fmt::Debug for Candidate<'_, V> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Candidate").field("backend", &self.backend).field("name", &self.name).finish_non_exhaustive()
    }
}

/// The candidates of a backend for a scene, the given rasterizer first. On the CPU the others have another
/// SIMD level or one thread; on a GPU, other kernels that its adapter can run.
///
/// # Errors
/// Those of [`Rasterizer::upload`] and of [`CpuRasterizer::new`].
pub(crate) fn candidates<'a, S>(base: AnyRasterizer, scene: &S) -> Result<Vec<Candidate<'a, S::View>>, Error>
where
    S: Scene + 'a,
    AnyRasterizer: Optimizer<S>,
{
    let others = match &base {
        AnyRasterizer::Cpu(cpu) => other_cpus(cpu)?,
        AnyRasterizer::Wgpu(gpu) => other_kernels(gpu),
        _ => Vec::new(),
    };
    let on_cpu = matches!(base, AnyRasterizer::Cpu(_));
    let first = Loaded::new(Box::new(base), scene)?;
    let splats = Rc::clone(&first.splats);
    let mut all = vec![candidate(first, None)];
    for (axis, value, rasterizer) in others {
        let rasterizer = Box::new(rasterizer);
        let loaded = match on_cpu {
            true => Loaded { rasterizer, splats: Rc::clone(&splats) },
            false => Loaded::new(rasterizer, scene)?,
        };
        all.push(candidate(loaded, Some(Change { axis: axis.to_owned(), value })));
    }
    Ok(all)
}

fn candidate<'a, S>(loaded: Loaded<Box<AnyRasterizer>, S>, change: Option<Change>) -> Candidate<'a, S::View>
where
    S: Scene + 'a,
    AnyRasterizer: Optimizer<S>,
{
    let rasterizer = &*loaded.rasterizer;
    let (backend, name) = (rasterizer.name().to_owned(), rasterizer.describe());
    Candidate { backend, name, change, renderer: Box::new(loaded) }
}

/// A setting of a backend, its value, and the rasterizer that has it.
type Other = (&'static str, String, AnyRasterizer);

fn other_cpus(base: &CpuRasterizer) -> Result<Vec<Other>, Error> {
    let (level, threads) = (base.simd_level(), base.threads());
    let start = |threads: usize, level: SimdLevel| {
        let settings = CpuSettings::default().with(|s| (s.threads, s.level) = (Some(threads), Some(level)));
        Ok(AnyRasterizer::Cpu(Box::new(CpuRasterizer::new(settings)?)))
    };
    let mut all = Vec::new();
    for other in SimdLevel::available().into_iter().filter(|&other| other != level) {
        all.push(("SIMD", other.to_string(), start(threads, other)?));
    }
    if threads > 1 {
        all.push(("threads", "1".to_owned(), start(1, level)?));
    }
    Ok(all)
}

fn other_kernels(base: &WgpuRasterizer) -> Vec<Other> {
    let others = [Kernels::Portable, Kernels::Subgroups].into_iter().filter(|&kernels| kernels != base.kernels());
    let opened = |kernels: Kernels| {
        let name = base.adapter().name.clone();
        let settings = WgpuSettings::default().with(|s| (s.adapter, s.kernels) = (Some(name), Some(kernels)));
        // Not every adapter can run every kind.
        let rasterizer = WgpuRasterizer::new(settings).block_on().ok()?;
        let value = format!("{kernels:?}").to_lowercase();
        Some(("kernels", value, AnyRasterizer::Wgpu(Box::new(rasterizer))))
    };
    others.filter_map(opened).collect()
}
