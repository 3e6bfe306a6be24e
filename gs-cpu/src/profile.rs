//! Where the time of a training step goes, stage by stage.

use gs_core::{
    AdamRates, Binning, Error, Loss, RenderSettings,
    profile::{Clock, Profile, Profiler, StageTime, still},
};
use web_time::Instant;

use crate::{CpuRasterizer, Target, kind::SceneKind, loss, tiles::Tiles, workspace::Workspace};

/// The stages of a training step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// In which order tiles see the Gaussians.
    Sort,
    /// What pixels need of each.
    Project,
    /// Which Gaussian touches which tiles.
    Bin,
    /// The image.
    Blend,
    /// The loss, and its gradient by the image.
    Loss,
    /// What each entry receives.
    BlendBwd,
    /// The three before it in one pass, where a training step does it so.
    Fused,
    /// What each Gaussian receives.
    ProjectBwd,
    /// The step.
    Adam,
}

impl Stage {
    const FROM_BIN: [Self; 7] =
        [Self::Bin, Self::Blend, Self::Loss, Self::BlendBwd, Self::Fused, Self::ProjectBwd, Self::Adam];

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
struct Pass<'a, S: SceneKind> {
    rasterizer: &'a CpuRasterizer,
    workspace: Workspace<S>,
    splats: &'a mut S::Splats,
    target: &'a Target,
    loss: Loss,
    rates: AdamRates,
    bias: S::Bias,
}

impl<S: SceneKind> Pass<'_, S> {
    fn run(&mut self, stage: Stage) -> Result<(), Error> {
        let Self { workspace, splats, target, bias, .. } = self;
        let level = self.rasterizer.level;
        match stage {
            Stage::Sort => S::sort(workspace, splats),
            Stage::Project => S::project(workspace, splats),
            Stage::Bin => workspace.tiles.bin()?,
            Stage::Blend => workspace.tiles.blend(level)?,
            Stage::Loss => {
                loss::loss(&mut workspace.tiles, target, &self.loss, level)?;
            }
            Stage::BlendBwd => workspace.tiles.blend_bwd(level)?,
            Stage::Fused => {
                workspace.tiles.blend_l2_fused(level, &target.rows)?;
            }
            Stage::ProjectBwd => S::project_bwd(workspace, splats, 1.0),
            Stage::Adam => S::adam(splats, bias, &self.rates, level, workspace),
        }
        Ok(())
    }
}

impl<S: SceneKind> Profiler<S> for CpuRasterizer {
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
        loss.validate()?;
        target.check_size(S::size(view))?;
        let is_fused = target.is_complete() && Tiles::is_fused(&settings.effects, loss);
        let stages = S::BEFORE_BIN.into_iter().chain(Stage::FROM_BIN);
        let stages = stages.filter(|&stage| stage != Stage::Fused || is_fused);
        let mut samples: Vec<(Stage, Vec<f64>)> =
            stages.map(|stage| (stage, Vec::with_capacity(repetitions))).collect();
        let pool = &S::resources(self).pool;
        let (workspace, bias) = (pool.take().tuned(self.tuning), S::Bias::default());
        let mut pass = Pass::<S> { rasterizer: self, workspace, splats, target, loss, rates: still(), bias };
        self.install(|| {
            S::prepare(&mut pass.workspace, pass.splats, view, settings, Binning::Fresh)?;
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
