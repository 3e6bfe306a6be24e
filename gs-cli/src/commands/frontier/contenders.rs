//! Everything that can render a scene here, to be compared: backends, SIMD levels, numbers of
//! threads, tunings, kernels.

use std::rc::Rc;

use gs_backend::{AnyRasterizer, Chosen, FutureExt as _, Wanted};
use gs_core::{Backend as _, Blend, Error, Optimizer, Parameterization, Rasterizer as _, Scene};
use gs_cpu::{Bounds, CpuRasterizer, CpuSettings, CpuTuning, SimdLevel};
use gs_lab::frontier::{Change, Contender, Loaded};
use gs_wgpu::{Kernels, WgpuRasterizer, WgpuSettings};

use crate::{
    backend::{BackendArgs, Choice, machine},
    failure::Failure,
    frontier_settings::{FrontierMachine, KernelsName},
    output,
};

/// Contenders, and the settings that choose each of them.
pub(super) type Contenders<'a, V> = (Vec<Contender<'a, V>>, Vec<FrontierMachine>);

/// All contenders for a scene with this blending. `--backend auto` has the CPU and, if there is an
/// adapter, wgpu.
pub(super) fn contenders<'a, S>(args: &BackendArgs, scene: &S, blend: Blend) -> Result<Contenders<'a, S::View>, Failure>
where
    S: Scene + 'a,
    AnyRasterizer: Optimizer<S>,
{
    let mut found = (Vec::new(), Vec::new());
    if args.backend != Choice::Wgpu && args.adapter.is_none() {
        let base = args.open_to_compare(Wanted::Cpu)?;
        output::note(&base.reason);
        add_cpu(base, scene, blend, &mut found)?;
    }
    let may_use_wgpu = args.backend != Choice::Cpu && args.simd.is_none();
    if may_use_wgpu
        && (args.backend == Choice::Wgpu || args.adapter.is_some() || !gs_wgpu::adapters().block_on().is_empty())
    {
        let base = args.open_to_compare(Wanted::Wgpu)?;
        output::note(&base.reason);
        add_wgpu(base, args, scene, &mut found)?;
    }
    Ok(found)
}

fn add_cpu<'a, S>(
    base: Chosen,
    scene: &S,
    blend: Blend,
    (all, machines): &mut Contenders<'a, S::View>,
) -> Result<(), Failure>
where
    S: Scene + 'a,
    AnyRasterizer: Optimizer<S>,
{
    let flags = machine(&base.rasterizer).flags;
    let splats = Rc::new(base.rasterizer.upload(scene, Parameterization::ScaleRotation)?);
    let AnyRasterizer::Cpu(rasterizer) = base.rasterizer else { return Ok(()) };
    let (level, threads) = (rasterizer.simd_level(), rasterizer.threads());
    let mut add = |rasterizer: CpuRasterizer, change: Option<(&str, String)>, flags: Vec<String>| {
        let tuning = rasterizer.tuning();
        all.push(Contender {
            backend: "cpu".to_owned(),
            name: rasterizer.describe(),
            change: change.map(|(axis, value)| Change { axis: axis.to_owned(), value }),
            renderer: Box::new(Loaded {
                rasterizer: AnyRasterizer::Cpu(Box::new(rasterizer)),
                splats: Rc::clone(&splats),
            }),
        });
        let cpu = (tuning != CpuTuning::default()).then_some(tuning);
        machines.push(FrontierMachine { flags, cpu, kernels: None });
    };
    add(*rasterizer, None, flags.clone());
    let start = |threads: usize, level: SimdLevel| {
        CpuRasterizer::new(CpuSettings { threads: Some(threads), level: Some(level) })
    };
    for other in SimdLevel::available().into_iter().filter(|&other| other != level) {
        let flags = ["--backend", "cpu", "--simd", &other.to_string()].map(str::to_owned).to_vec();
        add(start(threads, other)?, Some(("SIMD", other.to_string())), flags);
    }
    if threads > 1 {
        let flags = flags.iter().cloned().chain(["--threads", "1"].map(str::to_owned)).collect();
        add(start(1, level)?, Some(("threads", "1".to_owned())), flags);
    }
    for (axis, value, tuning) in tunings(blend) {
        add(start(threads, level)?.with_tuning(tuning)?, Some((axis, value)), flags.clone());
    }
    Ok(())
}

/// Tunings other than the default.
fn tunings(blend: Blend) -> Vec<(&'static str, String, CpuTuning)> {
    let usual = CpuTuning::default();
    let exponentials = [1, 8, 128, 256].map(|recurrence_rows| {
        let value = if recurrence_rows == 1 { "each row".to_owned() } else { format!("every {recurrence_rows} rows") };
        ("exp", value, CpuTuning { recurrence_rows, ..usual })
    });
    let rows: &[u16] = match blend {
        Blend::Sum => &[16, 64],
        Blend::Over => &[8, 16, 32],
    };
    let tiles = rows.iter().map(|&rows| ("tile rows", rows.to_string(), CpuTuning { tile_rows: Some(rows), ..usual }));
    let loose = ("bounds", "box".to_owned(), CpuTuning { bounds: Bounds::Box, ..usual });
    exponentials.into_iter().chain(tiles).chain([loose]).collect()
}

fn add_wgpu<'a, S>(
    base: Chosen,
    args: &BackendArgs,
    scene: &S,
    (all, machines): &mut Contenders<'a, S::View>,
) -> Result<(), Failure>
where
    S: Scene + 'a,
    AnyRasterizer: Optimizer<S>,
{
    let flags = machine(&base.rasterizer).flags;
    let AnyRasterizer::Wgpu(rasterizer) = base.rasterizer else { return Ok(()) };
    let usual = rasterizer.kernels();
    let mut add = |rasterizer: WgpuRasterizer, kernels: Option<KernelsName>| -> Result<(), Error> {
        let name = rasterizer.describe();
        let rasterizer = AnyRasterizer::Wgpu(Box::new(rasterizer));
        let splats = Rc::new(rasterizer.upload(scene, Parameterization::ScaleRotation)?);
        all.push(Contender {
            backend: "wgpu".to_owned(),
            name,
            change: kernels
                .map(|name| Change { axis: "kernels".to_owned(), value: format!("{name:?}").to_lowercase() }),
            renderer: Box::new(Loaded { rasterizer, splats }),
        });
        machines.push(FrontierMachine { flags: flags.clone(), cpu: None, kernels });
        Ok(())
    };
    add(*rasterizer, None)?;
    for name in [KernelsName::Portable, KernelsName::Subgroups] {
        if Kernels::from(name) == usual {
            continue;
        }
        let (adapter, kernels) = (args.adapter.clone(), Some(name.into()));
        #[allow(clippy::needless_update, reason = "a feature for tests adds a field")]
        let settings = WgpuSettings { adapter, kernels, ..WgpuSettings::default() };
        // Not every adapter can run every kind.
        if let Ok(other) = WgpuRasterizer::new(settings).block_on() {
            add(other, Some(name))?;
        }
    }
    Ok(())
}
