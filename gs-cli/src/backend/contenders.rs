//! All that can render a scene here, side by side: backends, instruction sets, numbers of threads, ways of going about the work.

use gs_core::Backend as _;
use gs_core::Rasterizer as _;
use pollster::FutureExt as _;
use std::rc::Rc;

use gs_core::{Blend, Error, Optimizer, Parameterization, Scene};
use gs_cpu::{Bounds, CpuRasterizer, CpuSettings, CpuTuning, SimdLevel};
use gs_lab::frontier::{Change, Contender, Loaded};
use gs_wgpu::{Kernels, WgpuRasterizer};

use crate::{
    backend::{AnyRasterizer, Backend, BackendArgs, Choice, machine, named},
    chosen_machine::{ChosenMachine, KernelsName},
    failure::Failure,
    output,
};

/// Contenders, and of each how to ask for it again.
pub(crate) type Contenders<'a, V> = (Vec<Contender<'a, V>>, Vec<ChosenMachine>);

/// All contenders for a scene that is blended like this. With `--backend auto`, the processor and, if there is an adapter, wgpu.
///
/// # Errors
/// As [`Backend::start`], and where the scene does not fit a backend.
pub(crate) fn contenders<'a, S>(args: &BackendArgs, scene: &S, blend: Blend) -> Result<Contenders<'a, S::View>, Failure>
where
    S: Scene + 'a,
    CpuRasterizer: Optimizer<S>,
    WgpuRasterizer: Optimizer<S>,
{
    let (mut all, mut machines) = (Vec::new(), Vec::new());
    let wants_cpu = args.backend != Choice::Wgpu && args.adapter.is_none();
    if wants_cpu {
        let base = Backend::start_compared(args, Choice::Cpu)?;
        output::note(&base.reason);
        add_cpu(base, scene, blend, (&mut all, &mut machines))?;
    }
    let may_use_wgpu = args.backend != Choice::Cpu && args.simd.is_none();
    if may_use_wgpu
        && (args.backend == Choice::Wgpu || args.adapter.is_some() || !gs_wgpu::adapters().block_on().is_empty())
    {
        let base = Backend::start_compared(args, Choice::Wgpu)?;
        output::note(&base.reason);
        add_wgpu(base, args, scene, (&mut all, &mut machines))?;
    }
    Ok((all, machines))
}

type Lists<'l, 'a, V> = (&'l mut Vec<Contender<'a, V>>, &'l mut Vec<ChosenMachine>);

fn add_cpu<'a, S>(
    base: Backend,
    scene: &S,
    blend: Blend,
    (all, machines): Lists<'_, 'a, S::View>,
) -> Result<(), Failure>
where
    S: Scene + 'a,
    CpuRasterizer: Optimizer<S>,
{
    let chosen = machine(&base).flags;
    let AnyRasterizer::Cpu(rasterizer) = base.rasterizer else { return Ok(()) };
    let (level, threads) = (rasterizer.simd_level(), rasterizer.threads());
    let splats = Rc::new(rasterizer.upload(scene, Parameterization::ScaleRotation)?);
    let mut add = |rasterizer: CpuRasterizer, change: Option<(&str, String)>, flags: Vec<String>| {
        let tuning = rasterizer.tuning();
        all.push(Contender {
            backend: "cpu".to_owned(),
            name: rasterizer.describe(),
            change: change.map(|(axis, value)| Change { axis: axis.to_owned(), value }),
            renderer: Box::new(Loaded { rasterizer, splats: Rc::clone(&splats) }),
        });
        let cpu = (tuning != CpuTuning::default()).then_some(tuning);
        machines.push(ChosenMachine { flags, cpu, kernels: None });
    };
    add(*rasterizer, None, chosen.clone());
    let start = |threads: usize, level: SimdLevel| {
        CpuRasterizer::new(CpuSettings { threads: Some(threads), level: Some(level) })
    };
    for other in SimdLevel::available().into_iter().filter(|&other| other != level) {
        let flags = ["--backend", "cpu", "--simd", &other.to_string()].map(str::to_owned).to_vec();
        add(start(threads, other)?, Some(("SIMD", other.to_string())), flags);
    }
    if threads > 1 {
        let flags = chosen.iter().cloned().chain(["--threads", "1"].map(str::to_owned)).collect();
        add(start(1, level)?, Some(("threads", "1".to_owned())), flags);
    }
    for (axis, value, tuning) in tunings(blend) {
        add(start(threads, level)?.with_tuning(tuning)?, Some((axis, value)), chosen.clone());
    }
    Ok(())
}

/// Other ways of going about the work than the usual.
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
    base: Backend,
    args: &BackendArgs,
    scene: &S,
    (all, machines): Lists<'_, 'a, S::View>,
) -> Result<(), Failure>
where
    S: Scene + 'a,
    WgpuRasterizer: Optimizer<S>,
{
    let flags = machine(&base).flags;
    let AnyRasterizer::Wgpu(rasterizer) = base.rasterizer else { return Ok(()) };
    let usual = rasterizer.kernels();
    let mut add = |rasterizer: WgpuRasterizer, kernels: Option<KernelsName>| -> Result<(), Error> {
        let splats = Rc::new(rasterizer.upload(scene, Parameterization::ScaleRotation)?);
        all.push(Contender {
            backend: "wgpu".to_owned(),
            name: rasterizer.describe(),
            change: kernels
                .map(|name| Change { axis: "kernels".to_owned(), value: format!("{name:?}").to_lowercase() }),
            renderer: Box::new(Loaded { rasterizer, splats }),
        });
        machines.push(ChosenMachine { flags: flags.clone(), cpu: None, kernels });
        Ok(())
    };
    add(*rasterizer, None)?;
    for name in [KernelsName::Portable, KernelsName::Subgroups] {
        if Kernels::from(name) == usual {
            continue;
        }
        // Not every adapter can run every kind.
        if let Ok(other) = named(args.adapter.as_deref(), Some(name.into())) {
            add(other, Some(name))?;
        }
    }
    Ok(())
}

impl From<KernelsName> for Kernels {
    fn from(name: KernelsName) -> Self {
        match name {
            KernelsName::Portable => Self::Portable,
            KernelsName::Subgroups => Self::Subgroups,
        }
    }
}
