//! Fitted scenes, for measurements of a single stage or step.

use gs_core::Optimizer as _;
use gs_core::{AdamRates, Binning, Blend, Canvas, Image, Loss, Rasterizer, RenderSettings, Scene2d, TrainStep};
use gs_cpu::CpuRasterizer;
use gs_train::{FitSettings, Preset, fit};
use pollster::FutureExt as _;

use super::{Quantiles, try_time};

/// A blending and a loss.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Variant {
    /// The name in reports.
    pub(crate) name: &'static str,
    /// How Gaussians combine.
    pub(crate) blend: Blend,
    /// What is minimised.
    pub(crate) loss: Loss,
}

/// The paper's loss.
pub(crate) const L1_DSSIM: Loss = Loss::PAPER;

/// The default of image fits.
pub(crate) const SUM_L2: Variant = Variant { name: "Sum, L2", blend: Blend::Sum, loss: Loss::L2 };

/// The paper's variant.
pub(crate) const OVER_L1_DSSIM: Variant = Variant { name: "Over, L1 + D-SSIM", blend: Blend::Over, loss: L1_DSSIM };

/// The paper's blending with the simplest loss.
pub(crate) const OVER_L2: Variant = Variant { name: "Over, L2", blend: Blend::Over, loss: Loss::L2 };

/// A fitted scene.
#[derive(Debug)]
pub(crate) struct Fitted {
    /// The Gaussians.
    pub(crate) scene: Scene2d,
    /// The settings of the fit.
    pub(crate) settings: FitSettings,
    /// PSNR of the 8-bit image, dB.
    pub(crate) psnr: f64,
}

impl Variant {
    /// The standard preset with this number of steps, blending and loss.
    pub(crate) fn settings(&self, image: &Image, gaussians: u32, iterations: u32) -> FitSettings {
        let standard = Preset::Standard.settings(gaussians, image.size()).with_iterations(iterations);
        standard.with(|s| {
            s.render = RenderSettings::blended(self.blend);
            s.loss = self.loss;
        })
    }

    /// Fits `image` by [`Self::settings`].
    pub(crate) fn fit(
        &self,
        rasterizer: &impl gs_core::Optimizer<Scene2d>,
        image: &Image,
        gaussians: u32,
        iterations: u32,
    ) -> Result<Fitted, gs_train::Error> {
        let settings = self.settings(image, gaussians, iterations);
        let fit = fit(rasterizer, image, settings.clone(), &mut ()).block_on()?;
        Ok(Fitted { scene: fit.scene, settings, psnr: fit.summary.psnr })
    }
}

impl Fitted {
    /// Seconds per iteration of continuing the fit of `image`, averaged over as many iterations as
    /// share their lists.
    pub(crate) fn iterations(
        &self,
        rasterizer: &CpuRasterizer,
        image: &Image,
        rebin_every: u32,
        repetitions: usize,
    ) -> Result<Quantiles, gs_core::Error> {
        let FitSettings { render: settings, loss, adam, parameterization, .. } = &self.settings;
        let mut splats = rasterizer.upload(&self.scene, *parameterization)?;
        let rasterizer = rasterizer.for_2d();
        let target = rasterizer.upload_target(image)?;
        let view = Canvas::new(image.width(), image.height());
        // With the learning rates of the end, the scene hardly changes.
        let rates: AdamRates = adam.at(1.0);
        let mut round = || {
            for step in 0..rebin_every {
                let binning = if step == 0 { Binning::Fresh } else { Binning::Reuse };
                let step = TrainStep { settings, loss: *loss, rates: &rates, binning };
                rasterizer.train_step(&mut splats, &view, &target, &step).block_on()?;
            }
            Ok(())
        };
        round()?;
        let seconds = try_time(repetitions * 4 / rebin_every as usize, round)?;
        Ok(Quantiles::of(&seconds).times(1.0 / f64::from(rebin_every)))
    }
}
