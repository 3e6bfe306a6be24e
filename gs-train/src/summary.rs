//! The result of a fit in one value: what `summary.json` holds.

use gs_core::{Image, Optimizer, Scene2d, edit::EditCounts, statistics::Culled};
use serde::{Deserialize, Deserializer, Serialize};

use crate::{
    clamped::Clamped,
    error::Error,
    quality::{ImageQuality, psnr_float},
    recovery::FreshStart,
    settings::FitSettings,
    shortfall::Shortfall,
    trainer::Trainer,
};

/// What a fit cost and what came of it.
///
/// Figures of quality are those of the 8-bit image that is written of the scene ([`ImageQuality::as_written`]). All numbers but the cost
/// (steps and seconds) describe the scene as it is, also where the fit returned to its first Gaussians at the end.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FitSummary {
    /// Columns of the target, px.
    pub width: u32,
    /// Rows of the target, px.
    pub height: u32,
    /// Gaussians of the scene.
    pub gaussians: u32,
    /// That there are clearly fewer than the settings allow, and why.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shortfall: Option<Shortfall>,
    /// Steps done, those before a fresh start included.
    pub iterations: u32,
    /// Time spent fitting, s; see [`Progress::seconds`](crate::Progress::seconds).
    pub seconds: f64,
    /// Mean absolute difference.
    pub l1: f64,
    /// dB; ∞ for equal images, which JSON writes as `null`.
    #[serde(deserialize_with = "infinite_where_null")]
    pub psnr: f64,
    /// PSNR of the rendering before it is rounded to 8 bits, held to 0..=1, dB: what no file has. ∞ as above.
    #[serde(default = "unknown", deserialize_with = "infinite_where_null")]
    pub psnr_float: f64,
    /// Structural similarity.
    pub ssim: f64,
    /// Multi-scale structural similarity; nothing for images too small for it.
    pub ms_ssim: Option<f64>,
    /// The backend and what it runs on.
    pub backend: String,
    /// Threads that computed, where the caller knows.
    pub threads: Option<u32>,
    /// The seed of all random numbers.
    pub seed: u32,
    /// The loss of the scene, in the unit of [`FitSettings::loss`].
    pub loss: Option<f32>,
    /// What density control did to its Gaussians, all rounds together; of those before a fresh start nothing is left.
    pub edits: EditCounts,
    /// How often the fit began again, and why.
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
    /// The summary of a fit as it stands, whose scene looks like `rendered` and from which `culled` were left out.
    ///
    /// # Errors
    /// [`gs_core::Error::SizesDiffer`] where `rendered` is not of the target's size; those of the backend.
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
            shortfall: Shortfall::of(trainer, &trainer.settings().policy),
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

/// What a summary of before there was such a number says of it.
fn unknown() -> f64 {
    f64::NAN
}

/// JSON has no infinity: `null` is what becomes of it.
pub(crate) fn infinite_where_null<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::INFINITY))
}
