//! A whole fit in one call.

use gs_core::{Image, Optimizer, Scene2d};

use super::{settings::FitSettings, summary::FitSummary};
use crate::{
    error::Error,
    run::{Observer, Outcome, Trainer, digest, fingerprint},
};

/// An image to fit. An [`Image`] alone converts into one.
#[derive(Debug, Clone, Copy)]
pub struct FitTarget<'a> {
    /// The image.
    pub image: &'a Image,
    /// How much each pixel counts, `[height · width]`, row-major, not negative; `None`: as
    /// [`FitSettings::tune`] says.
    pub weights: Option<&'a [f32]>,
}

impl<'a> From<&'a Image> for FitTarget<'a> {
    fn from(image: &'a Image) -> Self {
        Self { image, weights: None }
    }
}

impl FitTarget<'_> {
    /// What a checkpoint knows of the target: its size and hashes of its pixels and weights.
    pub(super) fn fingerprint(&self) -> String {
        let of_image = fingerprint(self.image);
        match self.weights {
            None => of_image,
            Some(weights) => {
                let hash = digest(weights.iter().flat_map(|weight| weight.to_le_bytes()));
                format!("{of_image}, weights {hash:016x}")
            }
        }
    }

    /// The weights of pixels under these settings, or `None` where all count 1.
    pub(super) fn weights(&self, settings: &FitSettings) -> Option<Vec<f32>> {
        self.weights.map(<[f32]>::to_vec).or_else(|| settings.tune.weights(self.image))
    }
}

/// Result of [`fit()`].
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// The Gaussians.
    pub scene: Scene2d,
    /// Rendering of the scene at the target's size, not clamped.
    pub image: Image,
    /// Cost and quality.
    pub summary: FitSummary,
    /// Whether all steps were done.
    pub outcome: Outcome,
}

/// Fits 2D Gaussians to an image. Pass `&mut ()` as observer to observe nothing.
///
/// # Errors
/// Those of [`Trainer::new`] and [`Trainer::run`].
///
/// # Examples
/// ```
/// use gs_cpu::{CpuRasterizer, CpuSettings};
/// use gs_train::{FitSettings, MetricsLog, fit, paper_target};
///
/// let rasterizer = CpuRasterizer::new(CpuSettings::default())?;
/// let settings = FitSettings::quick(50).with(|s| s.iterations = 20);
/// let mut log = MetricsLog::new(5);
/// let fit = pollster::block_on(fit(&rasterizer, &paper_target(), settings, &mut log))?;
/// assert_eq!(fit.summary.gaussians, 50);
/// assert!(log.rows().last().and_then(|row| row.psnr).is_some_and(|psnr| psnr > 15.0));
/// # Ok::<(), gs_train::Error>(())
/// ```
pub async fn fit<R: Optimizer<Scene2d>>(
    rasterizer: &R,
    target: impl Into<FitTarget<'_>>,
    settings: FitSettings,
    observer: &mut dyn Observer,
) -> Result<Fit, Error> {
    let mut trainer = Trainer::new(rasterizer, target, settings).await?;
    let outcome = trainer.run(observer).await?;
    let (image, culled) = trainer.render().await?;
    let summary = FitSummary::new(&trainer, &image, culled).await?;
    Ok(Fit { scene: trainer.scene().await?, image, summary, outcome })
}
