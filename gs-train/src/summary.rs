//! The result of a fit in one value: what `summary.json` holds.

use gs_core::{Image, PlanarScene, Rasterizer, edit::EditCounts, metrics, statistics::Culled};
use serde::{Deserialize, Deserializer, Serialize};

use crate::{
    clamped::Clamped, error::Error, joining::Join, recovery::FreshStart, settings::FitSettings, trainer::Trainer,
};

/// What a fit cost and what came of it. Qualities are those of the final rendering against the target, both clamped to 0..=1.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FitSummary {
    /// Columns of the target, px.
    pub width: u32,
    /// Rows of the target, px.
    pub height: u32,
    /// Gaussians at the end.
    pub gaussians: u32,
    /// Steps done.
    pub iterations: u32,
    /// Time spent fitting, s; see [`Progress::seconds`](crate::Progress::seconds).
    pub seconds: f64,
    /// Mean absolute difference.
    pub l1: f64,
    /// dB; ∞ for equal images, which JSON writes as `null`.
    #[serde(deserialize_with = "infinite_where_null")]
    pub psnr: f64,
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
    /// The loss before the last step, or of a fit under way the last that is known, in the unit of [`FitSettings::loss`]; nothing where
    /// no step was made.
    pub loss: Option<f32>,
    /// What density control did, all rounds together.
    pub edits: EditCounts,
    /// The effects that joined because they were called for.
    #[serde(default)]
    pub joins: Vec<Join>,
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
    pub fn new<R: Rasterizer<PlanarScene>>(
        trainer: &Trainer<'_, R>,
        rendered: &Image,
        culled: Culled,
    ) -> Result<Self, Error> {
        let target = trainer.target();
        let clamped = |value: f32| value.clamp(0.0, 1.0);
        let quality = metrics::compare((rendered, clamped), (target, clamped))?;
        Ok(Self {
            width: target.width(),
            height: target.height(),
            gaussians: trainer.count(),
            iterations: trainer.step(),
            seconds: trainer.seconds(),
            l1: quality.l1,
            psnr: quality.psnr,
            ssim: quality.ssim,
            ms_ssim: quality.ms_ssim,
            backend: trainer.backend(),
            threads: None,
            seed: trainer.settings().seed,
            loss: trainer.loss(),
            edits: *trainer.edits(),
            joins: trainer.joins().joins.clone(),
            fresh_starts: trainer.fresh_starts().to_vec(),
            culled,
            clamped: trainer.clamped()?,
            settings: trainer.settings().clone(),
        })
    }
}

/// JSON has no infinity: `null` is what becomes of it.
pub(crate) fn infinite_where_null<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::INFINITY))
}
