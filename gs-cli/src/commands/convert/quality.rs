//! The quality of a conversion: the PSNR over a data set's images before and after.

use std::{fmt, path::PathBuf};

use clap::Args;
use gs_backend::{AnyRasterizer, FutureExt as _};
use gs_core::counted;
use gs_io::{File3d, dataset::Dataset};
use gs_train::train::{Views, evaluate};
use serde::Serialize;

use crate::{
    failure::Failure,
    flags::{backend::BackendArgs, dataset::DatasetArgs, render_args::RenderArgs3d},
};

/// The flags for measuring the quality. Except for order and antialiasing, they need `--dataset`.
#[derive(Debug, Clone, Args)]
pub(super) struct QualityArgs {
    /// Measure the PSNR over the held-out views of this data set, as gs eval does, before and after
    /// the conversion
    #[arg(long, value_name = "DATASET")]
    pub(super) dataset: Option<PathBuf>,
    #[command(flatten)]
    images: DatasetArgs,
    #[command(flatten)]
    pub(super) render: RenderArgs3d,
    #[command(flatten)]
    backend: BackendArgs,
}

/// The quality before and after a conversion.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Quality {
    dataset: String,
    views: usize,
    /// Mean PSNR over the views, dB.
    psnr_before: f64,
    psnr_after: f64,
}

impl QualityArgs {
    /// Opens the backend that draws.
    pub(super) fn open(&self) -> Result<AnyRasterizer, Failure> {
        Ok(self.backend.open()?.rasterizer)
    }

    /// Reads the data set, if there is one, in the frame of the scene.
    pub(super) fn dataset(&self, scene: &File3d) -> Result<Option<Dataset>, Failure> {
        self.dataset.as_deref().map(|path| self.images.read_for(scene, path)).transpose()
    }

    /// Evaluates both scenes, each rendered as its file says.
    pub(super) fn measure(&self, dataset: &Dataset, before: &File3d, after: &File3d) -> Result<Quality, Failure> {
        let views = Views::of_dataset(dataset).cached();
        let rasterizer = self.open()?;
        let evaluation = |file: &File3d| {
            let render = self.render.settings(file, Some(dataset));
            evaluate(&rasterizer, &file.scene, views.test_or_train(), &render).block_on()
        };
        let (before, after) = (evaluation(before)?, evaluation(after)?);
        let dataset = self.dataset.iter().map(|path| path.display().to_string()).collect();
        Ok(Quality { dataset, views: after.views.len(), psnr_before: before.psnr, psnr_after: after.psnr })
    }
}

impl fmt::Display for Quality {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { dataset, views, psnr_before, psnr_after } = self;
        let [before, after] = [psnr_before, psnr_after].map(|psnr| match psnr.is_finite() {
            true => format!("{psnr:.2} dB"),
            false => "infinite".to_owned(),
        });
        let views = counted(*views, "view");
        write!(f, "PSNR {before} before, {after} after, mean over {views} of {dataset}")
    }
}
