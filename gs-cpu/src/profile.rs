//! Where the time of a training step goes, stage by stage.

use std::time::Instant;

use gs_core::{
    Adam, Binning, Blend, Canvas, Error, Loss, RenderSettings,
    effects::Statistics,
    profile::{Profile, StageTime},
};

use crate::{CpuRasterizer, PlanarCloud, PlanarTarget, adam, loss};

impl CpuRasterizer {
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
        view.validate()?;
        settings.validate()?;
        target.check_size(view.width, view.height)?;
        let names = ["project", "bin", "blend", "loss", "blend_bwd", "project_bwd", "adam", "fused"];
        let mut stages: Vec<StageTime> =
            names.iter().map(|&stage| StageTime { stage, seconds: Vec::with_capacity(repetitions) }).collect();
        let mut still = Adam::default();
        for group in [&mut still.mean, &mut still.scale, &mut still.rotation, &mut still.opacity, &mut still.color] {
            group.learning_rate = 0.0;
        }
        let rates = still.at(0.0);
        let mut workspace = self.pool.take();
        let mut bias = adam::BiasTable::default();
        self.threads.install(|| {
            workspace.prepare(cloud, view, settings, Binning::Fresh)?;
            for _ in 0..repetitions {
                let mut stage = 0;
                let mut lap = |start: Instant| {
                    stages[stage].seconds.push(start.elapsed().as_secs_f64());
                    stage += 1;
                };
                let start = Instant::now();
                workspace.project(cloud);
                lap(start);
                let start = Instant::now();
                workspace.bin()?;
                lap(start);
                let start = Instant::now();
                workspace.blend(self.level);
                lap(start);
                let start = Instant::now();
                loss::loss(&mut workspace, target, &loss, self.level);
                lap(start);
                let start = Instant::now();
                workspace.blend_bwd(self.level);
                lap(start);
                let start = Instant::now();
                workspace.project_bwd(cloud, 1.0);
                lap(start);
                let start = Instant::now();
                let gradient_of = |index: usize| workspace.gradient_of(index);
                adam::step(cloud, &mut bias, &rates, self.level, Statistics::None, gradient_of);
                lap(start);
                if settings.effects.blend == Blend::Sum {
                    let start = Instant::now();
                    workspace.blend_l2_fused(self.level, &target.rows);
                    lap(start);
                }
            }
            Ok::<(), Error>(())
        })?;
        stages.retain(|stage| !stage.seconds.is_empty());
        let profile = Profile { stages, pairs: workspace.bins.pairs(), entries: workspace.bins.entries.len() };
        self.pool.give(workspace);
        Ok(profile)
    }
}
