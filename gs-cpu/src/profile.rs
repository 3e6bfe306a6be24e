//! Where the time of a training step goes, stage by stage.

use std::time::Instant;

use gs_core::{
    AdamRates, Binning, Canvas, Error, Loss, PlanarScene, RenderSettings,
    profile::{Clock, Profile, Profiler, StageTime, still},
};

use crate::{
    CpuRasterizer, PlanarCloud, PlanarTarget,
    adam::{self, BiasTable},
    loss,
    rasterizer::check,
    traffic,
    workspace::Workspace,
};

/// The stages in their order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stage {
    /// In which order tiles see the Gaussians.
    Sort,
    Project,
    Bin,
    Blend,
    Loss,
    BlendBwd,
    /// The three before it in one pass, where a training step does it so.
    Fused,
    ProjectBwd,
    Adam,
}

impl Stage {
    const ALL: [Self; 9] = [
        Self::Sort,
        Self::Project,
        Self::Bin,
        Self::Blend,
        Self::Loss,
        Self::BlendBwd,
        Self::Fused,
        Self::ProjectBwd,
        Self::Adam,
    ];

    fn name(self) -> &'static str {
        match self {
            Self::Sort => "sort",
            Self::Project => "project",
            Self::Bin => "bin",
            Self::Blend => "blend",
            Self::Loss => "loss",
            Self::BlendBwd => "blend_bwd",
            Self::Fused => "fused",
            Self::ProjectBwd => "project_bwd",
            Self::Adam => "adam",
        }
    }

    fn replaces(self) -> &'static [&'static str] {
        match self {
            Self::Fused => &["blend", "loss", "blend_bwd"],
            _ => &[],
        }
    }

    fn visits_pairs(self) -> bool {
        matches!(self, Self::Blend | Self::BlendBwd | Self::Fused)
    }
}

/// What the stages compute with.
struct Pass<'a> {
    rasterizer: &'a CpuRasterizer,
    workspace: Workspace,
    cloud: &'a mut PlanarCloud,
    target: &'a PlanarTarget,
    loss: Loss,
    rates: AdamRates,
    bias: BiasTable,
}

impl Pass<'_> {
    fn run(&mut self, stage: Stage) -> Result<(), Error> {
        let Self { workspace, cloud, target, bias, .. } = self;
        let level = self.rasterizer.level;
        let effects = workspace.settings.effects;
        match stage {
            Stage::Sort => workspace.arrange(cloud, effects.blend),
            Stage::Project => workspace.project(cloud),
            Stage::Bin => workspace.bin()?,
            Stage::Blend => workspace.blend(level),
            Stage::Loss => {
                loss::loss(workspace, target, &self.loss, level);
            }
            Stage::BlendBwd => workspace.blend_bwd(level),
            Stage::Fused => {
                workspace.blend_l2_fused(level, &target.rows);
            }
            Stage::ProjectBwd => workspace.project_bwd(cloud, 1.0),
            Stage::Adam => {
                let gradient_of = |index: usize| workspace.gradient_of(index);
                adam::step(cloud, bias, &self.rates, level, effects.statistics, gradient_of);
            }
        }
        Ok(())
    }
}

impl Profiler<PlanarScene> for CpuRasterizer {
    fn profile(
        &self,
        cloud: &mut PlanarCloud,
        view: &Canvas,
        target: &PlanarTarget,
        settings: &RenderSettings,
        loss: Loss,
        repetitions: usize,
    ) -> Result<Profile, Error> {
        check(view, settings)?;
        loss.validate()?;
        target.check_size(view.width, view.height)?;
        let is_fused = Workspace::is_fused(&settings.effects, loss);
        let stages = Stage::ALL.into_iter().filter(|&stage| stage != Stage::Fused || is_fused);
        let mut samples: Vec<(Stage, Vec<f64>)> =
            stages.map(|stage| (stage, Vec::with_capacity(repetitions))).collect();
        let workspace = self.pool.take();
        let mut pass =
            Pass { rasterizer: self, workspace, cloud, target, loss, rates: still(), bias: BiasTable::default() };
        self.threads.install(|| {
            pass.workspace.prepare(pass.cloud, view, settings, Binning::Fresh)?;
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
        let Pass { workspace, cloud, .. } = pass;
        let pairs = workspace.bins.pairs();
        let stage_time = |(stage, seconds): (Stage, Vec<f64>)| StageTime {
            stage: stage.name(),
            seconds,
            pairs: if stage.visits_pairs() { pairs } else { 0 },
            traffic: traffic::of(stage, &workspace, cloud, &loss),
            replaces: stage.replaces(),
        };
        let stages = samples.into_iter().map(stage_time).collect();
        let profile = Profile { stages, clock: Clock::Host, pairs, entries: workspace.bins.entries.len() };
        self.pool.give(workspace);
        Ok(profile)
    }
}
