//! The time of each stage of a training step.

use gs_core::{
    AdamRates, Binning, Error, Loss, RenderSettings,
    profile::{Clock, Profile, Profiler, StageTime, still},
};
use web_time::Instant;

use crate::{
    kind::Kind, loss, rasterizer::CpuRasterizer, stage::Stage, target::Target, tiles::Tiles, workspace::Workspace,
};

/// The arguments of the stages.
struct Pass<'a, S: Kind> {
    rasterizer: &'a CpuRasterizer,
    workspace: Workspace<S::Buffers>,
    splats: &'a mut S::Splats,
    target: &'a Target,
    loss: Loss,
    rates: AdamRates,
    bias: S::Bias,
}

impl<S: Kind> Pass<'_, S> {
    fn run(&mut self, stage: Stage) -> Result<(), Error> {
        let Self { workspace, splats, target, bias, .. } = self;
        let level = self.rasterizer.level;
        match stage {
            Stage::Sort => S::sort(workspace, splats),
            Stage::Project => S::project(workspace, splats, level),
            Stage::Bin => S::bin(workspace, level)?,
            Stage::Blend => workspace.tiles.blend(level)?,
            Stage::Loss => {
                loss::loss(&mut workspace.tiles, target, &self.loss, level)?;
            }
            Stage::BlendBwd => workspace.tiles.blend_bwd(level)?,
            Stage::Fused => {
                workspace.tiles.blend_l2_fused(level, target)?;
            }
            Stage::ProjectBwd => S::project_bwd(workspace, splats, level, 1.0),
            Stage::Adam => S::adam(splats, bias, &self.rates, level, workspace),
            Stage::Update => S::update(splats, bias, &self.rates, level, workspace, 1.0),
        }
        Ok(())
    }
}

impl<S: Kind> Profiler<S> for CpuRasterizer {
    async fn profile(
        &self,
        splats: &mut S::Splats,
        view: &S::View,
        target: &Target,
        settings: &RenderSettings,
        loss: Loss,
        repetitions: usize,
    ) -> Result<Profile, Error> {
        S::check(view, settings)?;
        target.check_loss(loss)?;
        target.check_size(S::size(view))?;
        let is_fused = target.is_complete() && Tiles::is_fused(&settings.effects, loss);
        let stages = S::BEFORE_BIN.into_iter().chain(Stage::FROM_BIN).chain(S::AFTER_BLEND.iter().copied());
        let stages = stages.filter(|&stage| stage != Stage::Fused || is_fused);
        let mut samples: Vec<(Stage, Vec<f64>)> =
            stages.map(|stage| (stage, Vec::with_capacity(repetitions))).collect();
        let pool = &S::resources(&self.resources).pool;
        let (workspace, bias) = (pool.take(), S::Bias::default());
        let mut pass = Pass::<S> { rasterizer: self, workspace, splats, target, loss, rates: still(), bias };
        self.install(|| {
            S::prepare(&mut pass.workspace, pass.splats, view, settings, Binning::Fresh, self.level)?;
            samples.iter().try_for_each(|&(stage, _)| pass.run(stage))?;
            for _ in 0..repetitions {
                for (stage, seconds) in &mut samples {
                    let start = Instant::now();
                    pass.run(*stage)?;
                    seconds.push(start.elapsed().as_secs_f64());
                }
            }
            Ok::<(), Error>(())
        })?;
        let Pass { workspace, .. } = pass;
        let pairs = workspace.tiles.bins.pairs();
        let stage_time = |(stage, seconds): (Stage, Vec<f64>)| StageTime {
            stage: stage.name(),
            seconds,
            pairs: if stage.visits_pairs() { pairs } else { 0 },
            replaces: stage.replaces(),
        };
        let stages = samples.into_iter().map(stage_time).collect();
        let profile = Profile { stages, clock: Clock::Host, pairs, entries: workspace.tiles.bins.entries.len() };
        pool.give(workspace);
        Ok(profile)
    }
}
