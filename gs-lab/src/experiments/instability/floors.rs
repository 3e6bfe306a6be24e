//! The price of a minimum scale: the paper's fit with the paper's clamp and with this project's
//! minimum.

use gs_core::{Image, Optimizer, Scene2d};

use super::guard::{CLAMP_PX, unless_diverged};
use crate::experiments::{
    ExperimentSize, Laboratory, Picture,
    laboratory::{Ellipses, Run, Shown},
    paired::mean,
    set_up::paper_settings,
};
use gs_train::{Error, FitSettings};

/// The paper's fit with a minimum scale.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Floor {
    pub(crate) target: &'static str,
    /// The minimum scale, px.
    pub(crate) min_scale_px: f32,
    /// Final PSNR, dB, one value per seed; `None` for a fit that diverged.
    pub(crate) psnr: Vec<Option<f64>>,
    /// Share of the Gaussians with a scale below 1 px at the end, averaged over the fits that did
    /// not diverge.
    pub(crate) below_one_px: f64,
}

/// The paper's fit with another minimum scale.
pub(crate) fn floor_settings(extent: ExperimentSize, seed: u32, min_scale_px: f32) -> FitSettings {
    let mut settings = paper_settings(extent, seed);
    settings.adam.min_scale = min_scale_px;
    settings
}

impl Floor {
    /// Fits with this minimum, and a picture of the first that does not diverge.
    pub(super) fn measure<R: Optimizer<Scene2d>>(
        laboratory: &mut Laboratory<'_, R>,
        name: &'static str,
        target: &Image,
        min_scale_px: f32,
    ) -> Result<(Self, Option<Picture>), Error> {
        let extent = laboratory.extent();
        let mut runs: Vec<Option<Run>> = Vec::new();
        for seed in extent.seeds(6, 1) {
            let label = format!("{name}, σ ≥ {min_scale_px} px, seed {seed}");
            runs.push(unless_diverged(laboratory.fit(&label, target, floor_settings(extent, seed, min_scale_px)))?);
        }
        let picture = runs.iter().flatten().next().map(|run| {
            let render = &run.fit.summary.settings.render;
            let shown = Shown { size: target.size(), render, ellipses: Ellipses::LeftOut };
            let file = if min_scale_px == CLAMP_PX { "lines-clamped" } else { "lines-guarded" };
            let caption = format!("{name}, σ ≥ {min_scale_px} px: {:.1} dB.", run.psnr());
            laboratory.picture(file, caption, &run.fit.scene, shown)
        });
        Ok((Self::of(name, min_scale_px, &runs), picture.transpose()?))
    }

    fn of(target: &'static str, min_scale_px: f32, runs: &[Option<Run>]) -> Self {
        let below = |run: &Run| {
            let scales = &run.fit.scene.log_scales;
            scales.iter().filter(|s| s.min_element() < 0.0).count() as f64 / scales.len().max(1) as f64
        };
        Self {
            target,
            min_scale_px,
            psnr: runs.iter().map(|run| run.as_ref().map(Run::psnr)).collect(),
            below_one_px: mean(runs.iter().flatten().map(below)),
        }
    }

    /// Mean PSNR of the fits that did not diverge, dB; NaN if all did.
    pub(crate) fn mean_psnr(&self) -> f64 {
        mean(self.psnr.iter().copied().flatten())
    }

    /// Number of fits that diverged.
    pub(crate) fn diverged(&self) -> usize {
        self.psnr.iter().filter(|psnr| psnr.is_none()).count()
    }
}
