//! Presets of fits: the paper's experiment, and images at three levels of effort.

use gs_core::{
    Adam, Blend, Loss, Parameterization, RenderSettings,
    adam::{Group, Schedule},
};
use gs_density::{Grow, Policy, ResidualGrowth, Signal};

use super::{
    init::{Init, Random},
    settings::{ColorSolve, FitSettings, InitialCount},
    tune::Tune,
};
use crate::run::{Recovery, Rounds};

/// Image size, px, for which [`FitSettings::quick`], [`FitSettings::standard`] and
/// [`FitSettings::best`] choose learning rates: that of the Kodak test set.
const REFERENCE_SIZE: (u32, u32) = (768, 512);

/// Share of a run in which density is controlled.
const GROWTH_SHARE: f64 = 0.6;

/// Rounds of density control in a run of 50 steps, the least there are, and the power of the number
/// of steps with which they rise: 17 in 400 steps, 38 in 1,500.
///
/// A round takes as long as three to five steps. More rounds gain nothing in 400 steps. In 1,500, they
/// and [`MIN_SCALE_PX`] are 0.1 dB better than 15 rounds were
/// (`benchmarks/2026-11-24-epyc-2-cores/kodak.md`).
const LEAST_ROUNDS: f64 = 5.0;
const ROUNDS_POWER: f64 = 0.6;

/// Smallest scale in fits of images, px.
///
/// Narrower Gaussians fall between the pixels' centres: they help the fit at its own size little,
/// and draw scratches that nothing in the image asked for when it is enlarged. From about 0.45 px
/// on, quality at the fit's own size falls; at 0.25 px an enlargement by two is 0.5 to 0.8 dB worse.
const MIN_SCALE_PX: f32 = 0.4;

gs_core::choices! {
    /// A preset of a fit: settings by name.
    #[non_exhaustive]
    pub enum Preset {
        /// [`FitSettings::paper`].
        Paper = "paper": "The paper's experiment: 20 Gaussians that grow, front-to-back blending",
        /// [`FitSettings::quick`].
        Quick = "quick": "For a first look: a fraction of the time",
        /// [`FitSettings::standard`].
        Standard = "standard": "For images: the best within a second or so",
        /// [`FitSettings::best`].
        Best = "best": "More steps, a little better",
    }
}

impl Preset {
    /// The settings for at most `gaussians` on an image of `size` (columns, rows). The paper's
    /// ignore the size.
    pub fn settings(self, gaussians: u32, size: (u32, u32)) -> FitSettings {
        match self {
            Self::Paper => FitSettings { gaussians, ..FitSettings::paper() },
            Self::Quick => FitSettings::for_image(gaussians, size, QUICK_ITERATIONS),
            Self::Standard => FitSettings::for_image(gaussians, size, STANDARD_ITERATIONS),
            Self::Best => FitSettings::for_image(gaussians, size, BEST_ITERATIONS),
        }
    }
}

const QUICK_ITERATIONS: u32 = 50;
const STANDARD_ITERATIONS: u32 = 400;
const BEST_ITERATIONS: u32 = 1500;

impl Default for FitSettings {
    /// [`FitSettings::standard`] with 9,000 Gaussians.
    fn default() -> Self {
        Self::standard(9_000)
    }
}

impl FitSettings {
    /// The paper's experiment (§3): 20 random Gaussians of σ 15 px on white, blended front to back,
    /// grow to 600 in 2500 steps.
    ///
    /// They grow every 100 steps by forced growth together with the absolute threshold. Adam steps
    /// in scale and rotation on L1 + D-SSIM. Forced growth alone makes 39 of 20 by step 600, and
    /// 234 by step 2400. The union with the threshold, which most Gaussians exceed while the image
    /// is blurred, about doubles the number in each round, and reaches 600 between steps 500
    /// and 1000. Learning rates and initial opacity are not in the paper.
    pub fn paper() -> Self {
        Self {
            gaussians: 600,
            initial: InitialCount::Fixed(20),
            exactly: false,
            iterations: 2500,
            seed: 0,
            parameterization: Parameterization::ScaleRotation,
            render: RenderSettings::blended(Blend::Over).on([1.0; 3]),
            loss: Loss::PAPER,
            tune: Tune::Psnr,
            adam: Adam::default(),
            init: Init::Random(Random::default()),
            policy: Policy::Grow(Grow::paper(Signal::MeanGradient)),
            rounds: Rounds::until(100, 1000),
            recovery: Recovery::BeginAgain,
            rebin_every: 1,
            color_solve: ColorSolve::default(),
        }
    }

    /// A quick fit in 50 steps.
    pub fn quick(gaussians: u32) -> Self {
        Preset::Quick.settings(gaussians, REFERENCE_SIZE)
    }

    /// The standard fit in 400 steps: about a second on two cores at 9,000 Gaussians.
    pub fn standard(gaussians: u32) -> Self {
        Preset::Standard.settings(gaussians, REFERENCE_SIZE)
    }

    /// The best fit, in 1500 steps: 0.4 dB better than standard in nearly four times the time.
    pub fn best(gaussians: u32) -> Self {
        Preset::Best.settings(gaussians, REFERENCE_SIZE)
    }

    /// A fit of an image of `size` (columns, rows) in this many steps: order-free blending, steps
    /// in covariance factors, and growth by residual from 8 % of the budget to all of it.
    ///
    /// Dense scenes, whose Gaussians are small and overlap much, have smaller steps and a longer
    /// memory of squared gradients. Short runs have larger steps and less momentum. Scales are at
    /// least 0.4 px, so that the fit can be enlarged.
    pub fn for_image(gaussians: u32, size: (u32, u32), iterations: u32) -> Self {
        let start = ResidualGrowth::default().start_fraction;
        let density = f64::from(gaussians) / (f64::from(size.0) * f64::from(size.1)).max(1.0);
        let crowding = between(density.ln(), SPARSE.ln(), CROWDED.ln());
        let haste = between(-f64::from(iterations).ln(), -(150f64.ln()), -(50f64.ln()));
        let patience = between(f64::from(iterations).ln(), 150f64.ln(), f64::from(STANDARD_ITERATIONS).ln());
        let hurry = 1.0 + haste / 3.0;
        let group = |learning_rate: f64| {
            Group::default().with(|s| {
                s.learning_rate = (learning_rate * hurry) as f32;
                s.beta1 = (0.85 - 0.1 * haste + 0.05 * patience) as f32;
                s.beta2 = (0.9 + 0.05 * crowding) as f32;
                s.schedule = Schedule::Cosine { to: 0.05 };
            })
        };
        let shape = group(0.15 - 0.05 * crowding);
        let color = group(0.03 - 0.01 * crowding);
        let rounds = (LEAST_ROUNDS * (f64::from(iterations) / 50.0).powf(ROUNDS_POWER)).round().max(LEAST_ROUNDS);
        let every = ((f64::from(iterations) * GROWTH_SHARE / rounds).round() as u32).max(1);
        Self {
            gaussians,
            initial: InitialCount::Fraction(start),
            exactly: false,
            iterations,
            seed: 0,
            parameterization: Parameterization::CovarianceFactor,
            render: RenderSettings::blended(Blend::Sum),
            loss: Loss::L2,
            tune: Tune::Psnr,
            adam: Adam::default().with(|s| {
                s.mean = shape;
                s.scale = shape;
                s.rotation = shape;
                s.opacity = color;
                s.color = color;
                s.epsilon = 1e-12;
                s.min_scale = MIN_SCALE_PX;
                s.max_scale = size.0.max(size.1).max(1) as f32;
            }),
            init: Init::default(),
            policy: Policy::Residual(ResidualGrowth::default()),
            rounds: Rounds::until(every, every * rounds as u32),
            recovery: Recovery::BeginAgain,
            rebin_every: 4,
            color_solve: ColorSolve { at_start: 20, after_edit: 1 },
        }
    }

    /// Returns this fit with another number of steps; the rounds of density control are scaled.
    pub fn with_iterations(mut self, iterations: u32) -> Self {
        let scale = |step: u32| {
            let scaled = u64::from(step) * u64::from(iterations) / u64::from(self.iterations.max(1));
            u32::try_from(scaled).unwrap_or(u32::MAX).max(step.min(1))
        };
        if self.iterations > 0 && iterations > 0 {
            let Rounds { every, from, until } = self.rounds;
            self.rounds = Rounds { every: scale(every), from: scale(from), until: scale(until) };
        }
        self.iterations = iterations;
        self
    }
}

/// Gaussians per pixel between which learning rates are interpolated: 9,000 and 70,000 on an image
/// of 768×512 px, where they were tuned.
const SPARSE: f64 = 9_000.0 / (768.0 * 512.0);
const CROWDED: f64 = 70_000.0 / (768.0 * 512.0);

/// Position of `value` between `from` and `to`, 0 to 1.
fn between(value: f64, from: f64, to: f64) -> f64 {
    ((value - from) / (to - from)).clamp(0.0, 1.0)
}
