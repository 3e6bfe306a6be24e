//! Small fits in which the optimizer may shrink a scale to zero by itself.

use gs_backend::FutureExt as _;
use gs_core::{Image, Loss, Optimizer, Scene2d, metrics::l1_and_psnr};
use gs_density::Policy;

use super::guard::Guard;
use super::textbook::Textbook;
use crate::result::mean;
use gs_train::{Error, FitSettings, Init, InitialCount, Rounds, Trainer, init::Random};

/// Number of Gaussians.
pub(super) const SMALL_GAUSSIANS: u32 = 6;

/// Step sizes of Adam for scales in the textbook solver, px; the paper names none. The last brings
/// scales to zero, and is the only one of the quick form.
const SCALE_RATES_PX: [f32; 3] = [0.05, 0.2, 1.0];

/// Small fits with a guard.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Free {
    pub(super) guard: Guard,
    /// Step size of Adam for scales, px; `None` for the product, which moves their logarithms.
    pub(super) scale_rate_px: Option<f32>,
    /// A fit per seed.
    pub(super) trajectories: Vec<Trajectory>,
}

/// A small fit.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Trajectory {
    /// Whether the loss or the gradients stopped being finite.
    pub(super) diverged: bool,
    /// The smallest |σ| before any step and after the last, px.
    pub(super) smallest_scale_px: f64,
    /// Final PSNR, dB; `None` if it diverged.
    pub(super) psnr: Option<f64>,
    /// (step, smallest |σ| before it in px), at every fourth step.
    pub(super) scales: Vec<(f64, f64)>,
}

/// The product's fit of a small scene: L1, no growth, as many steps as with the textbook solver.
pub(super) fn small_settings(seed: u32) -> FitSettings {
    FitSettings::paper().with(|s| {
        s.seed = seed;
        s.gaussians = SMALL_GAUSSIANS;
        s.initial = InitialCount::Fixed(SMALL_GAUSSIANS);
        s.iterations = 800;
        s.init = Init::Random(Random::default().with(|s| s.scale_px = 3.0));
        s.loss = Loss::L1;
        s.policy = Policy::None;
        s.rounds = Rounds::NEVER;
    })
}

impl Free {
    /// Fits with all guards; those of the textbook solver with each step size.
    pub(super) fn measure_all<R: Optimizer<Scene2d>>(
        rasterizer: &R,
        is_quick: bool,
        target: &Image,
    ) -> Result<Vec<Self>, Error> {
        let (rates, seeds) = if is_quick { (&SCALE_RATES_PX[2..], 0..10) } else { (&SCALE_RATES_PX[..], 0..20) };
        let mut all = Vec::new();
        for guard in Guard::ALL {
            let Some(guards) = guard.of_textbook() else {
                let trajectories = seeds.clone().map(|seed| Trajectory::by_product(rasterizer, target, seed)).collect();
                all.push(Self { guard, scale_rate_px: None, trajectories: Result::from_iter::<Vec<_>>(trajectories)? });
                continue;
            };
            for &rate in rates {
                let trajectory = |seed| {
                    let settings = small_settings(seed);
                    let scene = Trainer::new(rasterizer, target, settings.clone()).block_on()?.scene().block_on()?;
                    let textbook = Textbook::new(&scene, settings.render.background, guards, rate);
                    Trajectory::by_textbook(target, settings.iterations, textbook)
                };
                let trajectories = seeds.clone().map(trajectory).collect::<Result<_, Error>>()?;
                all.push(Self { guard, scale_rate_px: Some(rate), trajectories });
            }
        }
        Ok(all)
    }

    pub(super) fn fits(&self) -> usize {
        self.trajectories.len()
    }

    pub(super) fn diverged(&self) -> usize {
        self.trajectories.iter().filter(|trajectory| trajectory.diverged).count()
    }

    /// The smallest |σ| of all fits, px.
    pub(super) fn smallest_scale_px(&self) -> f64 {
        self.trajectories.iter().map(|trajectory| trajectory.smallest_scale_px).fold(f64::INFINITY, f64::min)
    }

    /// Mean final PSNR of the fits that did not diverge, dB; `None` if all did.
    pub(super) fn psnr(&self) -> Option<f64> {
        let psnr = mean(self.trajectories.iter().filter_map(|trajectory| trajectory.psnr));
        (!psnr.is_nan()).then_some(psnr)
    }
}

impl Trajectory {
    fn new() -> Self {
        Self { diverged: false, smallest_scale_px: f64::INFINITY, psnr: None, scales: Vec::new() }
    }

    /// Records the smallest scale before a step, counted from 1.
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
        Ok(Self { psnr: Some(l1_and_psnr(&image, target)?.1), ..trajectory })
    }

    fn by_product<R: Optimizer<Scene2d>>(rasterizer: &R, target: &Image, seed: u32) -> Result<Self, Error> {
        let mut trajectory = Self::new();
        let mut trainer = Trainer::new(rasterizer, target, small_settings(seed)).block_on()?;
        while !trainer.is_finished() {
            trajectory.note(trainer.step() + 1, smallest_scale_px(&trainer.scene().block_on()?));
            if unless_diverged(trainer.step_once().block_on())?.is_none() {
                return Ok(Self { diverged: true, ..trajectory });
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

/// The result of a step; `None` if it diverged, which the experiment counts. Other errors end the
/// experiment.
fn unless_diverged<T>(stepped: Result<T, Error>) -> Result<Option<T>, Error> {
    match stepped {
        Err(Error::Diverged { .. }) => Ok(None),
        stepped => stepped.map(Some),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_divergence_is_counted_and_other_errors_are_not() {
        let diverged = Error::Diverged { step: 3, loss: f32::NAN, suspect: None };
        assert_eq!(unless_diverged::<()>(Err(diverged)).unwrap(), None);
        assert_eq!(unless_diverged(Ok(7)).unwrap(), Some(7));
        let error = unless_diverged::<()>(Err(Error::Finished { iterations: 3 })).unwrap_err();
        assert!(matches!(error, Error::Finished { iterations: 3 }), "{error:?}");
    }
}
