//! Commands that solve for the colours under `Sum`: conjugate gradients on the normal equations.

use gs_core::{Blend, Canvas, Error, RenderSettings, Scene2d, effects::Statistics};

use crate::{
    blend::Differentiated,
    dispatch::{Commands, Groups, dispatch_some},
    fault::unsupported,
    gpu::Gpu,
    layout::{CONJUGATE_BYTES, Step},
    loss::Comparison,
    shaders::Variant,
    splats::Splats,
    target::Target,
    tiles::groups_of,
    workspace::{Pools, Workspace},
};

/// Moves the colours towards the least-squares solution.
pub(crate) async fn solve_colors(
    gpu: &Gpu,
    pools: &Pools,
    splats: &Splats<Scene2d>,
    view: &Canvas,
    target: &Target,
    settings: &RenderSettings,
    iterations: u32,
) -> Result<(), Error> {
    if settings.effects.blend != Blend::Sum {
        return Err(unsupported("solving for colours under `over`, where the image is not linear in them"));
    }
    let mut settings = *settings;
    settings.effects.statistics = Statistics::None;
    splats.settle(gpu).await?;
    let mut workspace = pools.pool_2d.take(gpu)?;
    workspace.set(gpu, splats, view, &settings)?;
    let describe = |w: &Workspace<Scene2d>| w.describe(gpu, splats, None, None);
    workspace.with_lists(gpu, splats, describe, |_, _| Ok(())).await?;
    let step = describe(&workspace);
    let without_background = gpu.storage("step", &[Step { background: [0.0; 3], ..step }])?;
    workspace.write_step(gpu, &step);
    let mut commands = Commands::new(gpu);
    let n = u64::from(workspace.tiles.gaussians);
    workspace.buffers.vectors.ensure(gpu, n * CONJUGATE_BYTES)?;
    workspace.buffers.scalars.ensure(gpu, 64)?;
    let Workspace { tiles, .. } = &mut workspace;
    tiles.partial.ensure(gpu, n.div_ceil(256) * 16)?;
    tiles.encode_blend(gpu, &mut commands);
    tiles.encode_comparison(gpu, &mut commands, target, Comparison::Difference)?;
    tiles.encode_blend_bwd(gpu, &mut commands, Differentiated::Loss(target))?;
    workspace.encode_solver(gpu, &mut commands, splats, "solve_start", None);
    workspace.encode_solver(gpu, &mut commands, splats, "solve_scalars", Some(0));
    // From here on, the image is that of a direction, without background.
    let (step, bytes) = (&workspace.tiles.step, size_of::<Step>() as u64);
    commands.encoder().copy_buffer_to_buffer(&without_background, 0, step, 0, bytes);
    for _ in 0..iterations {
        let Workspace { tiles, .. } = &mut workspace;
        tiles.encode_blend(gpu, &mut commands);
        let differentiated = match target.weights {
            None => Differentiated::Image,
            Some(_) => {
                tiles.encode_comparison(gpu, &mut commands, target, Comparison::Image)?;
                Differentiated::Own
            }
        };
        tiles.encode_blend_bwd(gpu, &mut commands, differentiated)?;
        workspace.encode_solver(gpu, &mut commands, splats, "solve_product", None);
        workspace.encode_solver(gpu, &mut commands, splats, "solve_scalars", Some(1));
        workspace.encode_solver(gpu, &mut commands, splats, "solve_step", None);
        workspace.encode_solver(gpu, &mut commands, splats, "solve_scalars", Some(2));
        workspace.encode_solver(gpu, &mut commands, splats, "solve_direction", None);
    }
    workspace.encode_solver(gpu, &mut commands, splats, "solve_end", None);
    commands.submit(gpu);
    pools.pool_2d.give(workspace);
    gpu.check()
}

impl Workspace<Scene2d> {
    fn encode_solver(
        &self,
        gpu: &Gpu,
        commands: &mut Commands,
        splats: &Splats<Scene2d>,
        entry_point: &'static str,
        scalars: Option<u32>,
    ) {
        let buffers = [
            &self.tiles.step,
            &self.tiles.projected.buffer,
            &self.tiles.offsets.buffer,
            &self.tiles.slots.buffer,
            &self.buffers.vectors.buffer,
            &self.tiles.partial.buffer,
            &self.buffers.scalars.buffer,
            &splats.state.gaussians,
        ];
        let used: &[u32] = match entry_point {
            "solve_start" => &[0, 1, 2, 3, 4, 5],
            "solve_product" => &[0, 2, 3, 4, 5],
            "solve_step" => &[0, 1, 4, 5, 6],
            "solve_direction" => &[0, 1, 4, 6],
            "solve_end" => &[0, 1, 4, 7],
            _ => &[0, 5, 6],
        };
        let bindings: Vec<&wgpu::Buffer> = used.iter().map(|&number| buffers[number as usize]).collect();
        let variant = Variant { constant: scalars.map(|which| ("WHICH", which)), ..Variant::default() };
        let groups = match scalars {
            None => groups_of(gpu, u64::from(self.tiles.gaussians), 256),
            Some(_) => Groups::Direct(1, 1),
        };
        dispatch_some(gpu, commands, entry_point, variant, (used, &bindings), groups);
    }
}
