//! The backends whose contenders are compared, according to the flags.

use gs_backend::{AnyRasterizer, FutureExt as _, Wanted};
use gs_core::{Blend, Optimizer, Scene};
use gs_lab::{
    price::frontier::{Candidate, Contender, FrontierMachine, cpu_contenders, wgpu_contenders},
    study::Machine,
};

use crate::{backend::BackendArgs, failure::Failure, output};

/// Contenders, and the settings that choose each of them.
pub(super) type Contenders<'a, V> = (Vec<Contender<'a, V>>, Vec<FrontierMachine>);

/// All contenders for a scene with this blending. `--backend auto` has the CPU and, if there is an
/// adapter, wgpu.
pub(super) fn contenders<'a, S>(args: &BackendArgs, scene: &S, blend: Blend) -> Result<Contenders<'a, S::View>, Failure>
where
    S: Scene + 'a,
    AnyRasterizer: Optimizer<S>,
{
    let mut found: Vec<Candidate<'a, S::View>> = Vec::new();
    if args.backend != Wanted::Wgpu && args.adapter.is_none() {
        let base = args.open_to_compare(Wanted::Cpu)?;
        output::note(&base.reason);
        if let AnyRasterizer::Cpu(rasterizer) = base.rasterizer {
            let threads = rasterizer.threads();
            let flags = |other: &AnyRasterizer| flags_of(other, threads);
            found.extend(cpu_contenders(*rasterizer, scene, blend, flags)?);
        }
    }
    let may_use_wgpu = args.backend != Wanted::Cpu && args.simd.is_none();
    if may_use_wgpu
        && (args.backend == Wanted::Wgpu || args.adapter.is_some() || !gs_wgpu::adapters().block_on().is_empty())
    {
        let base = args.open_to_compare(Wanted::Wgpu)?;
        output::note(&base.reason);
        if let AnyRasterizer::Wgpu(rasterizer) = base.rasterizer {
            let flags = |other: &AnyRasterizer| Machine::of(other).flags;
            found.extend(wgpu_contenders(*rasterizer, &args.request()?.wgpu, scene, flags)?);
        }
    }
    Ok(found.into_iter().unzip())
}

/// The flags that choose a rasterizer; those of threads only where they differ from the usual ones.
fn flags_of(rasterizer: &AnyRasterizer, usual_threads: usize) -> Vec<String> {
    let mut flags = Machine::of(rasterizer).flags;
    if let AnyRasterizer::Cpu(cpu) = rasterizer
        && cpu.threads() != usual_threads
    {
        flags.extend(["--threads".to_owned(), cpu.threads().to_string()]);
    }
    flags
}
