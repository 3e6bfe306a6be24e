//! The contenders that a backend has: SIMD levels, numbers of threads, tunings, kernels.

use std::rc::Rc;

use gs_backend::AnyRasterizer;
use gs_backend::FutureExt as _;
use gs_core::{Backend as _, Blend, Error, Optimizer, Parameterization, Rasterizer as _, Scene};
use gs_cpu::{Bounds, CpuRasterizer, CpuSettings, CpuTuning, SimdLevel};
use gs_wgpu::{Kernels, WgpuRasterizer, WgpuSettings};

use super::{Change, Contender, FrontierMachine, KernelsName, Loaded};

/// A contender, and the settings that choose it.
pub type Candidate<'a, V> = (Contender<'a, V>, FrontierMachine);

/// The contenders for a scene on the CPU: the given rasterizer, the other SIMD levels, one thread,
/// and tunings for this blending. `flags` gives the flags of `gs` that choose a rasterizer.
///
/// # Errors
/// Those of [`Rasterizer::upload`](gs_core::Rasterizer::upload) and of [`CpuRasterizer::new`].
pub fn cpu_contenders<'a, S>(
    rasterizer: CpuRasterizer,
    scene: &S,
    blend: Blend,
    flags: impl Fn(&AnyRasterizer) -> Vec<String>,
) -> Result<Vec<Candidate<'a, S::View>>, Error>
where
    S: Scene + 'a,
    AnyRasterizer: Optimizer<S>,
{
    let (level, threads, tuning) = (rasterizer.simd_level(), rasterizer.threads(), rasterizer.tuning());
    let start = |threads: usize, level: SimdLevel| {
        CpuRasterizer::new(CpuSettings::default().with(|s| (s.threads, s.level) = (Some(threads), Some(level))))
    };
    let base = AnyRasterizer::Cpu(Box::new(rasterizer));
    let splats = Rc::new(base.upload(scene, Parameterization::ScaleRotation)?);
    let mut found = Vec::new();
    let mut add = |rasterizer: AnyRasterizer, tuning: CpuTuning, change: Option<(&str, String)>| {
        let machine = FrontierMachine {
            flags: flags(&rasterizer),
            cpu: (tuning != CpuTuning::default()).then_some(tuning),
            kernels: None,
        };
        let contender = Contender {
            backend: "cpu".to_owned(),
            name: rasterizer.describe(),
            change: change.map(|(axis, value)| Change { axis: axis.to_owned(), value }),
            renderer: Box::new(Loaded { rasterizer, splats: Rc::clone(&splats) }),
        };
        found.push((contender, machine));
    };
    let usual = CpuTuning::default();
    let boxed = |rasterizer: CpuRasterizer| AnyRasterizer::Cpu(Box::new(rasterizer));
    add(base, tuning, None);
    for other in SimdLevel::available().into_iter().filter(|&other| other != level) {
        add(boxed(start(threads, other)?), usual, Some(("SIMD", other.to_string())));
    }
    if threads > 1 {
        add(boxed(start(1, level)?), usual, Some(("threads", "1".to_owned())));
    }
    for (axis, value, tuning) in tunings(blend) {
        add(boxed(start(threads, level)?.with_tuning(tuning)?), tuning, Some((axis, value)));
    }
    Ok(found)
}

/// Tunings other than the default.
fn tunings(blend: Blend) -> Vec<(&'static str, String, CpuTuning)> {
    let usual = CpuTuning::default();
    let exponentials = [1, 8, 128, 256].map(|recurrence_rows| {
        let value = if recurrence_rows == 1 { "each row".to_owned() } else { format!("every {recurrence_rows} rows") };
        ("exp", value, usual.with(|s| s.recurrence_rows = recurrence_rows))
    });
    let rows: &[u16] = match blend {
        Blend::Sum => &[16, 64],
        Blend::Over => &[8, 16, 32],
    };
    let tiles = rows.iter().map(|&rows| ("tile rows", rows.to_string(), usual.with(|s| s.tile_rows = Some(rows))));
    let loose = ("bounds", "box".to_owned(), usual.with(|s| s.bounds = Bounds::Box));
    exponentials.into_iter().chain(tiles).chain([loose]).collect()
}

/// The contenders for a scene on a GPU: the given rasterizer, which was opened with these settings,
/// and the other kernels that its adapter can run. `flags` gives the flags of `gs` that choose a
/// rasterizer.
///
/// # Errors
/// Those of [`Rasterizer::upload`](gs_core::Rasterizer::upload).
pub fn wgpu_contenders<'a, S>(
    rasterizer: WgpuRasterizer,
    settings: &WgpuSettings,
    scene: &S,
    flags: impl Fn(&AnyRasterizer) -> Vec<String>,
) -> Result<Vec<Candidate<'a, S::View>>, Error>
where
    S: Scene + 'a,
    AnyRasterizer: Optimizer<S>,
{
    let usual = rasterizer.kernels();
    let mut found = Vec::new();
    let mut add = |rasterizer: WgpuRasterizer, kernels: Option<KernelsName>| -> Result<(), Error> {
        let rasterizer = AnyRasterizer::Wgpu(Box::new(rasterizer));
        let splats = Rc::new(rasterizer.upload(scene, Parameterization::ScaleRotation)?);
        let machine = FrontierMachine { flags: flags(&rasterizer), cpu: None, kernels };
        let contender = Contender {
            backend: "wgpu".to_owned(),
            name: rasterizer.describe(),
            change: kernels
                .map(|name| Change { axis: "kernels".to_owned(), value: format!("{name:?}").to_lowercase() }),
            renderer: Box::new(Loaded { rasterizer, splats }),
        };
        found.push((contender, machine));
        Ok(())
    };
    add(rasterizer, None)?;
    for (name, kernels) in [(KernelsName::Portable, Kernels::Portable), (KernelsName::Subgroups, Kernels::Subgroups)] {
        if kernels == usual {
            continue;
        }
        let settings = settings.clone().with(|s| s.kernels = Some(kernels));
        // Not every adapter can run every kind.
        if let Ok(other) = WgpuRasterizer::new(settings).block_on() {
            add(other, Some(name))?;
        }
    }
    Ok(found)
}
