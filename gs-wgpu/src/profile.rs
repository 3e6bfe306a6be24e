//! Where the time of a training step goes, stage by stage: each stage is sent alone and waited for, so that its time is that of its
//! dispatches and of one round trip to the device.

use std::time::Instant;

use gs_core::{
    Adam, Canvas, Error, Loss, RenderSettings,
    profile::{Profile, StageTime},
};

use crate::{PlanarCloud, PlanarTarget, WgpuRasterizer, rasterizer::check, workspace::Differentiated};

impl WgpuRasterizer {
    /// Runs every stage `repetitions` times, interleaved, on a cloud that stays as it is but for its Adam moments (the learning
    /// rates are 0).
    ///
    /// # Errors
    /// Those of [`Rasterizer::train_step`](gs_core::Rasterizer::train_step).
    pub fn profile(
        &self,
        cloud: &mut PlanarCloud,
        view: &Canvas,
        target: &PlanarTarget,
        settings: &RenderSettings,
        loss: Loss,
        repetitions: usize,
    ) -> Result<Profile, Error> {
        check(view, settings)?;
        target.check_size(view.width, view.height)?;
        let gpu = &self.gpu;
        cloud.settle(gpu)?;
        let mut still = Adam::default();
        for group in [&mut still.mean, &mut still.scale, &mut still.rotation, &mut still.opacity, &mut still.color] {
            group.learning_rate = 0.0;
        }
        let rates = still.at(0.0);
        let mut workspace = self.pool.take(gpu)?;
        workspace.set(gpu, cloud, view, settings)?;
        let status = self.with_lists(
            &mut workspace,
            cloud,
            |w| w.describe(cloud, Some(loss), Some(&rates)),
            |w, encoder| {
                w.encode_image_and_gradient(gpu, encoder, cloud, target, loss)?;
                w.encode_blend(gpu, encoder, cloud);
                w.encode_loss(gpu, encoder, target, Some(loss))?;
                w.encode_blend_bwd(gpu, encoder, cloud, Differentiated::Loss);
                w.encode_project_bwd(gpu, encoder, cloud);
                w.encode_adam(gpu, encoder, cloud);
                // For every pipeline that is measured to be there.
                w.encode_lists(gpu, encoder, cloud, false);
                Ok(())
            },
        )?;
        let names = ["project", "bin", "blend", "loss", "blend_bwd", "fused", "project_bwd", "adam"];
        let mut stages: Vec<StageTime> =
            names.iter().map(|&stage| StageTime { stage, seconds: Vec::with_capacity(repetitions) }).collect();
        for _ in 0..repetitions {
            for StageTime { stage, seconds } in &mut stages {
                let mut encoder = self.encoder();
                match *stage {
                    "project" => workspace.encode_lists(gpu, &mut encoder, cloud, false),
                    "bin" => workspace.encode_lists(gpu, &mut encoder, cloud, true),
                    "blend" => workspace.encode_blend(gpu, &mut encoder, cloud),
                    "fused" => workspace.encode_image_and_gradient(gpu, &mut encoder, cloud, target, loss)?,
                    "loss" => workspace.encode_loss(gpu, &mut encoder, target, Some(loss))?,
                    "blend_bwd" => workspace.encode_blend_bwd(gpu, &mut encoder, cloud, Differentiated::Loss),
                    "project_bwd" => workspace.encode_project_bwd(gpu, &mut encoder, cloud),
                    _ => workspace.encode_adam(gpu, &mut encoder, cloud),
                }
                let start = Instant::now();
                gpu.queue.submit([encoder.finish()]);
                gpu.wait()?;
                seconds.push(start.elapsed().as_secs_f64());
            }
        }
        self.pool.give(workspace);
        let entries = status.entries as usize;
        Ok(Profile { stages, pairs: 256 * entries as u64, entries })
    }
}
