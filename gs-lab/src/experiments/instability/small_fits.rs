//! Small fits in which the optimiser may drive a scale to zero by itself, if the guard lets it.

use gs_core::{Image, Loss, Optimizer, Scene2d};
use gs_density::Policy;
use pollster::FutureExt as _;

use super::{Guard, unless_diverged};
use crate::{experiments::Laboratory, experiments::paired::mean, experiments::textbook::Textbook};
use gs_train::{Error, FitSettings, Init, InitialCount, Rounds, Trainer, init::Random, l1_and_psnr};

/// Gaussians of a small fit.
pub(super) const SMALL_GAUSSIANS: u32 = 6;

/// Adam's steps for the scales in the fits without this project's guards, px. The paper names none. The last is the one that brings scales
/// to zero, and the only one of the quick form.
const SCALE_RATES_PX: [f32; 3] = [0.05, 0.2, 1.0];

/// Small fits with one guard, in which the optimiser does what it wants.
#[derive(Debug, Clone, PartialEq)]
pub struct Free {
    /// What guards them.
    pub guard: Guard,
    /// Adam's step for the scales, px; nothing for the product, which moves their logarithms.
    pub scale_rate_px: Option<f32>,
    /// One a seed.
    pub trajectories: Vec<Trajectory>,
}

/// One small fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    /// Whether its loss or its gradients stopped being finite.
    pub diverged: bool,
    /// The smallest |σ| before any step and after the last, px.
    pub smallest_scale_px: f64,
    /// PSNR at the end, dB; nothing where it diverged.
    pub psnr: Option<f64>,
    /// (step, the smallest |σ| before it in px), at every fourth step.
    pub scales: Vec<(f64, f64)>,
}

/// The product's fit of a small start: L1, no growth, as many steps as the textbook's.
pub fn small_settings(seed: u32) -> FitSettings {
    FitSettings {
        seed,
        gaussians: SMALL_GAUSSIANS,
        initial: InitialCount::Fixed(SMALL_GAUSSIANS),
        iterations: 800,
        init: Init::Random(Random { scale_px: 3.0, ..Random::default() }),
        loss: Loss::L1,
        policy: Policy::None,
        rounds: Rounds::NEVER,
        ..FitSettings::paper()
    }
}

impl Free {
    /// All guards; the textbook's at each step of the scales.
    pub(super) fn measure_all<R: Optimizer<Scene2d>>(
        laboratory: &mut Laboratory<'_, R>,
        target: &Image,
    ) -> Result<Vec<Self>, Error> {
        let rates = laboratory.extent().choose(&SCALE_RATES_PX[..], &SCALE_RATES_PX[2..]);
        let seeds = laboratory.extent().seeds(20, 10);
        let mut all = Vec::new();
        for guard in Guard::ALL {
            let Some(guards) = guard.of_textbook() else {
                let trajectories = seeds.clone().map(|seed| Trajectory::by_product(laboratory, target, seed)).collect();
                all.push(Self { guard, scale_rate_px: None, trajectories: Result::from_iter::<Vec<_>>(trajectories)? });
                continue;
            };
            for &rate in rates {
                let trajectory = |seed| {
                    let settings = small_settings(seed);
                    let scene = Trainer::new(laboratory.rasterizer(), target, settings.clone())
                        .block_on()?
                        .scene()
                        .block_on()?;
                    let textbook = Textbook::new(&scene, settings.render.background, guards, rate);
                    Trajectory::by_textbook(target, settings.iterations, textbook)
                };
                let trajectories = seeds.clone().map(trajectory).collect::<Result<_, Error>>()?;
                all.push(Self { guard, scale_rate_px: Some(rate), trajectories });
            }
        }
        Ok(all)
    }

    /// How many fits.
    pub fn fits(&self) -> usize {
        self.trajectories.len()
    }

    /// How many of them diverged.
    pub fn diverged(&self) -> usize {
        self.trajectories.iter().filter(|trajectory| trajectory.diverged).count()
    }

    /// The smallest |σ| met in any of them, px.
    pub fn smallest_scale_px(&self) -> f64 {
        self.trajectories.iter().map(|trajectory| trajectory.smallest_scale_px).fold(f64::INFINITY, f64::min)
    }

    /// PSNR at the end of the fits that lived, dB, mean; nothing where none did.
    pub fn psnr(&self) -> Option<f64> {
        let psnr = mean(self.trajectories.iter().filter_map(|trajectory| trajectory.psnr));
        (!psnr.is_nan()).then_some(psnr)
    }
}

impl Trajectory {
    fn new() -> Self {
        Self { diverged: false, smallest_scale_px: f64::INFINITY, psnr: None, scales: Vec::new() }
    }

    /// Takes note of the smallest scale before a step, counted from 1.
    fn note(&mut self, step: u32, scale_px: f64) {
        self.smallest_scale_px = self.smallest_scale_px.min(scale_px);
        if step % 4 == 1 {
            self.scales.push((step.into(), scale_px));
        }
    }

    fn by_textbook(target: &Image, iterations: u32, mut textbook: Textbook) -> Result<Self, Error> {
        let mut trajectory = Self::new();
        for step in 1..=iterations {
            let found = textbook.step(target);
            trajectory.note(step, found.smallest_scale_px.into());
            if !(found.loss.is_finite() && found.has_finite_gradients) {
                return Ok(Self { diverged: true, ..trajectory });
            }
        }
        trajectory.note(iterations + 1, textbook.smallest_scale_px().into());
        let image = textbook.render(target.width(), target.height())?;
        Ok(Self { psnr: Some(l1_and_psnr(&image, target).1), ..trajectory })
    }

    fn by_product<R: Optimizer<Scene2d>>(
        laboratory: &mut Laboratory<'_, R>,
        target: &Image,
        seed: u32,
    ) -> Result<Self, Error> {
        let mut trajectory = Self::new();
        let mut trainer = Trainer::new(laboratory.rasterizer(), target, small_settings(seed)).block_on()?;
        laboratory.watch().on_fit(&format!("thin lines, seed {seed}"));
        while !trainer.is_finished() {
            trajectory.note(trainer.step() + 1, smallest_scale_px(&trainer.scene().block_on()?));
            match unless_diverged(trainer.step_once().block_on())? {
                Some(progress) => laboratory.watch().on_step(&progress),
                None => return Ok(Self { diverged: true, ..trajectory }),
            }
        }
        let scene = trainer.scene().block_on()?;
        trajectory.note(trainer.step() + 1, smallest_scale_px(&scene));
        Ok(Self { psnr: Some(trainer.quality().block_on()?.psnr), ..trajectory })
    }
}

fn smallest_scale_px(scene: &Scene2d) -> f64 {
    scene.iter().map(|g| f64::from(g.log_scale.min_element().exp())).fold(f64::INFINITY, f64::min)
}
