//! The summary of a fit, as in `summary.json`.

use gs_core::{Culled, Image, Optimizer, Scene2d, edit::EditCounts};
use serde::{Deserialize, Serialize};

use super::settings::FitSettings;
use crate::{
    error::Error,
    run::{Clamped, FreshStart, ImageQuality, Shortfall, Trainer, infinite_where_null, psnr_float},
};

/// Cost and quality of a fit.
///
/// Quality is measured on the 8-bit image of the scene ([`ImageQuality::as_written`]). All
/// numbers except the cost (steps and seconds) describe the final scene, also where the fit
/// returned to its first Gaussians.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct FitSummary {
    /// Columns of the target, px.
    pub width: u32,
    /// Rows of the target, px.
    pub height: u32,
    /// Number of Gaussians of the scene.
    pub gaussians: u32,
    /// Why there are clearly fewer Gaussians than the settings allow, where this is so:
    /// [`Trainer::shortfall`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shortfall: Option<Shortfall>,
    /// Steps done, those before a restart included.
    pub iterations: u32,
    /// Training time, s; see [`Progress::seconds`](crate::Progress::seconds).
    pub seconds: f64,
    /// Mean absolute difference.
    pub l1: f64,
    /// PSNR, dB; ∞ for equal images, which JSON writes as `null`.
    #[serde(deserialize_with = "infinite_where_null")]
    pub psnr: f64,
    /// PSNR of the rendering before it is rounded to 8 bits, clamped to 0..=1, dB. ∞ as above.
    #[serde(default = "unknown", deserialize_with = "infinite_where_null")]
    pub psnr_float: f64,
    /// Structural similarity.
    pub ssim: f64,
    /// Multi-scale structural similarity; `None` for images too small for it.
    pub ms_ssim: Option<f64>,
    /// Name of the backend and what it runs on.
    pub backend: String,
    /// Number of threads, where the caller knows it.
    pub threads: Option<u32>,
    /// Seed of all random numbers.
    pub seed: u32,
    /// Loss of the scene, in the unit of [`FitSettings::loss`].
    pub loss: Option<f32>,
    /// Edits of density control since the start or the last restart.
    pub edits: EditCounts,
    /// Restarts of the fit.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fresh_starts: Vec<FreshStart>,
    /// Gaussians that the final rendering left out.
    pub culled: Culled,
    /// Gaussians whose scales are at a bound.
    #[serde(default)]
    pub clamped: Clamped,
    /// All settings, to repeat the fit.
    pub settings: FitSettings,
}

impl FitSummary {
    /// The summary of a fit in its current state, whose rendering is `rendered` without the
    /// `culled` Gaussians.
    ///
    /// # Errors
    /// [`gs_core::Error::SizesDiffer`] where `rendered` is not of the target's size; those of the
    /// backend.
    pub async fn new<R: Optimizer<Scene2d>>(
        trainer: &Trainer<'_, R>,
        rendered: &Image,
        culled: Culled,
    ) -> Result<Self, Error> {
        let target = trainer.target();
        let ImageQuality { psnr, ssim, ms_ssim, l1 } = ImageQuality::as_written(rendered, target)?;
        Ok(Self {
            width: target.width(),
            height: target.height(),
            gaussians: trainer.count(),
            shortfall: trainer.shortfall(),
            iterations: trainer.step(),
            seconds: trainer.seconds(),
            l1,
            psnr,
            psnr_float: psnr_float(rendered, target)?,
            ssim,
            ms_ssim,
            backend: trainer.backend(),
            threads: None,
            seed: trainer.settings().seed,
            loss: Some(trainer.scene_loss().await?),
            edits: *trainer.edits(),
            fresh_starts: trainer.fresh_starts().to_vec(),
            culled,
            clamped: trainer.clamped().await?,
            settings: trainer.settings().clone(),
        })
    }
}

/// The value in summaries of versions without this number.
fn unknown() -> f64 {
    f64::NAN
}
