//! Scenes as a fit makes them, for measurements of a single stage or step.

use gs_core::{Blend, Image, Loss, PlanarScene, Rasterizer, RenderSettings};
use gs_train::{FitSettings, Preset, fit};

/// A blending and a loss.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Variant {
    /// As reports call it.
    pub(crate) name: &'static str,
    /// How Gaussians combine.
    pub(crate) blend: Blend,
    /// What is minimised.
    pub(crate) loss: Loss,
}

/// The paper's loss.
pub(crate) const L1_DSSIM: Loss = Loss::PAPER;

/// What images are fitted with.
pub(crate) const SUM_L2: Variant = Variant { name: "Sum, L2", blend: Blend::Sum, loss: Loss::L2 };

/// What the paper fits with.
pub(crate) const OVER_L1_DSSIM: Variant = Variant { name: "Over, L1 + D-SSIM", blend: Blend::Over, loss: L1_DSSIM };

/// The paper's blending, the simplest loss.
pub(crate) const OVER_L2: Variant = Variant { name: "Over, L2", blend: Blend::Over, loss: Loss::L2 };

/// A fitted scene.
#[derive(Debug)]
pub(crate) struct Fitted {
    /// The Gaussians.
    pub(crate) scene: PlanarScene,
    /// What they were fitted with.
    pub(crate) settings: FitSettings,
    /// How well they were, dB.
    pub(crate) psnr: f64,
}

impl Variant {
    /// Fits `image` by the standard preset in so many steps, with this blending and loss.
    pub(crate) fn fit(
        &self,
        rasterizer: &impl Rasterizer<PlanarScene>,
        image: &Image,
        gaussians: u32,
        iterations: u32,
    ) -> Result<Fitted, gs_train::Error> {
        let standard = Preset::Standard.settings(gaussians, image.size()).with_iterations(iterations);
        let settings = FitSettings { render: RenderSettings::blended(self.blend), loss: self.loss, ..standard };
        let fit = fit(rasterizer, image, settings.clone(), &mut ())?;
        Ok(Fitted { scene: fit.scene, settings, psnr: fit.summary.psnr })
    }
}
