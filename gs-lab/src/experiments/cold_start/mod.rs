//! The cold start (paper §3.4.1, §5.1, Fig. 9 top): small Gaussians along the border that do not
//! reach the shapes, and its cures.
//!
//! The pull of the shapes is the difference between the gradients with the shapes in the target and
//! those with a white target. The gradients that remain without shapes are due to the border: a
//! Gaussian that is not white is pushed about by the white below it.

mod findings;

use glam::Vec2;
use gs_backend::FutureExt as _;
use gs_core::{Canvas, Image, Loss, Optimizer, Scene2d, effects::Statistics};
use gs_density::{Grow, Policy, ResidualGrowth, Signal, WhenFlat};

use super::{
    Cell, Circumstance, Claim, Findings, Laboratory, Number, Picture, Table,
    findings::significant,
    laboratory::{Ellipses, Run, SHARP_DB, Shown, seeds_in_words},
    paired::{mean, median},
    set_up::paper_settings,
};
use crate::report::figure::{Axis, Figure, Marks, Series};
use crate::synthetic::SyntheticTarget;
use gs_train::{Error, FitSettings, Init, Trainer, init::Colors, init::Periphery};

/// σ of the small Gaussians on the border, px. With the window of the loss, they reach at most 9 px
/// into the image.
pub(crate) const COLD_SCALE_PX: f32 = 1.0;

/// σ of the large Gaussians on the border, px: that of the paper's good start.
pub(crate) const LARGE_SCALE_PX: f32 = 15.0;

/// The step of the good start whose loss the other starts have to reach.
const MILESTONE: usize = 500;

/// A start, and the cure that is applied.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Start {
    /// 20 Gaussians of σ 15 px anywhere: the paper's own start, which works.
    Good,
    /// 20 small white Gaussians on the border.
    ColdWhite,
    /// 20 small Gaussians on the border in random colours.
    ColdRandom,
    /// [`Self::ColdRandom`] with growth by gradient, forced even where gradients are zero.
    ColdForced,
    /// [`Self::ColdRandom`] with growth by residual.
    ColdResidual,
    /// 20 large Gaussians on the border in random colours.
    LargeVariance,
}

impl Start {
    pub(crate) const ALL: [Self; 6] =
        [Self::Good, Self::ColdWhite, Self::ColdRandom, Self::ColdForced, Self::ColdResidual, Self::LargeVariance];

    /// The name in reports.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Good => "good start: σ 15 px anywhere",
            Self::ColdWhite => "cold: σ 1 px on the border, white",
            Self::ColdRandom => "cold: σ 1 px on the border",
            Self::ColdForced => "cold, growth forced where flat",
            Self::ColdResidual => "cold, seeding by residual",
            Self::LargeVariance => "σ 15 px on the border",
        }
    }

    /// The paper's fit with this start.
    pub(crate) fn settings(self, paper: FitSettings) -> FitSettings {
        let border = |scale_px, colors| {
            Init::Periphery(Periphery::default().with(|s| {
                s.scale_px = scale_px;
                s.colors = colors;
            }))
        };
        let init = match self {
            Self::Good => paper.init,
            Self::ColdWhite => border(COLD_SCALE_PX, Colors::Target),
            Self::ColdRandom | Self::ColdForced | Self::ColdResidual => border(COLD_SCALE_PX, Colors::Random),
            Self::LargeVariance => border(LARGE_SCALE_PX, Colors::Random),
        };
        let policy = match self {
            Self::ColdForced => {
                Policy::Grow(Grow::paper(Signal::MeanGradient).with(|s| s.when_flat = WhenFlat::Forced))
            }
            Self::ColdResidual => Policy::Residual(ResidualGrowth::default()),
            _ => paper.policy.clone(),
        };
        paper.with(|s| {
            s.init = init;
            s.policy = policy;
        })
    }
}

/// The positional gradients of a start before the first step, in normalised device units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pull {
    pub(crate) start: Start,
    /// The loss. L1 depends on a Gaussian's own pixels, D-SSIM on pixels up to 10 px further.
    pub(crate) loss: Loss,
    pub(crate) gaussians: usize,
    /// Number of Gaussians with a gradient that the shapes change.
    pub(crate) moved_by_shapes: usize,
    /// The largest change of a positional gradient by the shapes.
    pub(crate) by_shapes: f64,
    /// The largest positional gradient.
    pub(crate) in_all: f64,
}

/// The fits of a start, averaged over seeds.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Trajectory {
    pub(crate) start: Start,
    /// PSNR at the end, dB, mean.
    pub(crate) psnr: f64,
    /// Gaussians at the end, mean.
    pub(crate) count: f64,
    /// Median steps until the loss is that of the good start of the same seed at step 500; `None`
    /// if most fits never get there.
    pub(crate) steps_to_milestone: Option<f64>,
    /// Mean of the final loss divided by the loss at a fifth of the steps; 1 is flat.
    pub(crate) late_ratio: f64,
    /// Mean of the final loss divided by the first.
    pub(crate) loss_ratio: f64,
    /// The single fits.
    pub(crate) by_seed: Vec<Ending>,
}

/// A fit of a start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Ending {
    /// PSNR at the end, dB.
    pub(crate) psnr: f64,
    /// Steps until the loss is that of the good start of this seed at step 500; `None` if it never
    /// is.
    pub(crate) steps_to_milestone: Option<u32>,
    /// The final loss divided by the loss at a fifth of the steps.
    pub(crate) late_ratio: f64,
    /// The final loss divided by the first.
    pub(crate) loss_ratio: f64,
}

/// The results of the experiment.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ColdStartMeasured {
    /// The pull on white, randomly coloured, large, and the good start's Gaussians, under L1 and
    /// under the paper's loss.
    pub(crate) pulls: Vec<Pull>,
    /// All starts, as in [`Start::ALL`].
    pub(crate) trajectories: Vec<Trajectory>,
    seeds: u32,
    iterations: u32,
    losses: Vec<Series>,
    pictures: Vec<Picture>,
}

/// Fits from the border with and without cures, and from the paper's start.
pub(crate) fn measure<R: Optimizer<Scene2d>>(laboratory: &mut Laboratory<'_, R>) -> Result<ColdStartMeasured, Error> {
    let extent = laboratory.extent();
    let target = SyntheticTarget::PAPER_8_BIT.image();
    let seeds = extent.choose(3, 1);
    let settings = |start: Start, seed| start.settings(paper_settings(extent, seed));
    let mut runs: Vec<Vec<Run>> = Vec::new();
    for start in Start::ALL {
        let one = |seed| laboratory.fit(&format!("{}, seed {seed}", start.name()), &target, settings(start, seed));
        runs.push((0..seeds).map(one).collect::<Result<_, Error>>()?);
    }
    let good = &runs[0];
    let trajectories = Start::ALL.iter().zip(&runs).map(|(&start, runs)| trajectory(start, runs, good)).collect();
    let mut pulls = Vec::new();
    for start in [Start::ColdWhite, Start::ColdRandom, Start::LargeVariance, Start::Good] {
        let scene =
            Trainer::new(laboratory.rasterizer(), &target, settings(start, 0)).block_on()?.scene().block_on()?;
        for loss in [Loss::L1, Loss::PAPER] {
            let settings = settings(start, 0).with(|s| s.loss = loss);
            pulls.push(pull(laboratory.rasterizer(), start, &scene, &target, &settings)?);
        }
    }
    let mut pictures = Vec::new();
    for (start, name) in [(2, "cold"), (4, "residual"), (5, "large-variance")] {
        let run = &runs[start][0];
        let shown = Shown {
            size: target.size(),
            render: &run.fit.summary.settings.render,
            ellipses: if start == 2 { Ellipses::Drawn } else { Ellipses::LeftOut },
        };
        let caption = format!("{}: {:.1} dB at the end.", Start::ALL[start].name(), run.psnr());
        pictures.push(laboratory.picture(name, caption, &run.fit.scene, shown)?);
    }
    Ok(ColdStartMeasured {
        pulls,
        trajectories,
        seeds,
        iterations: settings(Start::Good, 0).iterations,
        losses: Start::ALL
            .iter()
            .zip(&runs)
            .map(|(start, runs)| Series::line(start.name(), runs[0].loss_curve()))
            .collect(),
        pictures,
    })
}

fn trajectory(start: Start, runs: &[Run], good: &[Run]) -> Trajectory {
    let ending = |(run, good): (&Run, &Run)| {
        let end = run.smoothed_loss(run.losses.len());
        Ending {
            psnr: run.psnr(),
            steps_to_milestone: run.first_step_below(good.smoothed_loss(MILESTONE)),
            late_ratio: end / run.smoothed_loss(run.losses.len() / 5),
            loss_ratio: end / f64::from(run.losses[0]),
        }
    };
    let by_seed: Vec<Ending> = runs.iter().zip(good).map(ending).collect();
    let over_seeds = |value: fn(&Ending) -> f64| mean(by_seed.iter().map(value));
    let middle = median(by_seed.iter().map(|ending| ending.steps_to_milestone.map_or(f64::INFINITY, f64::from)));
    Trajectory {
        start,
        psnr: over_seeds(|ending| ending.psnr),
        count: mean(runs.iter().map(|run| f64::from(run.count()))),
        steps_to_milestone: middle.is_finite().then_some(middle),
        late_ratio: over_seeds(|ending| ending.late_ratio),
        loss_ratio: over_seeds(|ending| ending.loss_ratio),
        by_seed,
    }
}

/// The effect of the shapes on the positional gradients of a scene before the first step.
fn pull<R: Optimizer<Scene2d>>(
    rasterizer: &R,
    start: Start,
    scene: &Scene2d,
    target: &Image,
    settings: &FitSettings,
) -> Result<Pull, Error> {
    let white = Image::filled(target.width(), target.height(), [1.0; 3])?;
    let with = positional_gradients(rasterizer, scene, target, settings)?;
    let without = positional_gradients(rasterizer, scene, &white, settings)?;
    // Gradients are means over all pixels, so both targets give the same sums.
    let device = Vec2::new(target.width() as f32, target.height() as f32) * 0.5;
    let norms = |v: Vec<Vec2>| v.into_iter().map(|v| f64::from((v * device).length())).collect::<Vec<_>>();
    let by_shapes = norms(with.iter().zip(&without).map(|(a, b)| *a - *b).collect());
    Ok(Pull {
        start,
        loss: settings.loss,
        gaussians: with.len(),
        moved_by_shapes: by_shapes.iter().filter(|&&norm| norm != 0.0).count(),
        by_shapes: by_shapes.into_iter().fold(0.0, f64::max),
        in_all: norms(with).into_iter().fold(0.0, f64::max),
    })
}

/// ∂L/∂μ of every Gaussian, px⁻¹.
fn positional_gradients<R: Optimizer<Scene2d>>(
    rasterizer: &R,
    scene: &Scene2d,
    target: &Image,
    settings: &FitSettings,
) -> Result<Vec<Vec2>, Error> {
    let mut render = settings.render;
    render.effects.statistics = Statistics::None;
    let splats = rasterizer.upload(scene, settings.parameterization)?;
    let canvas = Canvas::new(target.width(), target.height());
    let frame = rasterizer.forward(&splats, &canvas, &render).block_on()?;
    let target = rasterizer.upload_target(target)?;
    let (_, gradients) = rasterizer.backward(&splats, frame, &target, &settings.loss).block_on()?;
    Ok(rasterizer.gradients(&splats, &gradients).block_on()?.means)
}

impl ColdStartMeasured {
    /// The fits of a start.
    pub(crate) fn trajectory(&self, start: Start) -> &Trajectory {
        self.trajectories.iter().find(|trajectory| trajectory.start == start).expect("all starts are measured")
    }

    /// The pull on a start's Gaussians under a loss, if it was measured.
    pub(crate) fn pull(&self, start: Start, loss: Loss) -> Option<&Pull> {
        self.pulls.iter().find(|pull| pull.start == start && pull.loss == loss)
    }
}
