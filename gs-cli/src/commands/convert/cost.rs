//! What a conversion costs: how close the scene comes to a data set's images before it and after.

use std::{fmt, path::PathBuf};

use clap::Args;
use gs_io::{SpatialFile, TrainedWith, dataset::read_dataset};
use gs_train::spatial::Views;
use serde::Serialize;

use crate::{
    backend::{Backend, BackendArgs},
    commands::eval::Judge,
    failure::Failure,
    shown::ShownArgs,
    train::DatasetArgs,
};

/// The flags by which a conversion is judged.
#[derive(Debug, Clone, Args)]
pub(super) struct CostArgs {
    /// Measure the PSNR over the held-out views of this data set, as gs eval does, before the conversion and after
    #[arg(long, value_name = "DATASET")]
    dataset: Option<PathBuf>,
    #[command(flatten)]
    photographs: DatasetArgs,
    #[command(flatten)]
    shown: ShownArgs,
    #[command(flatten)]
    backend: BackendArgs,
}

/// How close a scene comes to the images before and after a conversion.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Cost {
    dataset: String,
    views: usize,
    /// Mean PSNR over the views, dB.
    psnr_before: f64,
    psnr_after: f64,
}

impl CostArgs {
    /// Fails where a flag asks for how a scene is shown that is neither stored nor judged.
    ///
    /// # Errors
    /// Bad usage.
    pub(super) fn check(&self) -> Result<(), Failure> {
        match self.dataset.is_none() && self.shown.is_of_pictures() {
            true => Err(Failure::usage("--background and --sh-degree are for judging a scene").mend("add --dataset")),
            false => Ok(()),
        }
    }

    /// How the scene was trained: as flags say, otherwise as its file does.
    pub(super) fn trained_with(&self, file: TrainedWith) -> TrainedWith {
        self.shown.trained_with(file)
    }

    /// Judges both scenes, each shown as its file says; `None` where there is no data set to judge by.
    ///
    /// # Errors
    /// Where the data set cannot be read or the backend fails.
    pub(super) fn measure(&self, before: &SpatialFile, after: &SpatialFile) -> Result<Option<Cost>, Failure> {
        let Some(path) = &self.dataset else { return Ok(None) };
        let dataset = read_dataset(path, &self.photographs.settings())?;
        let Views { train, test, .. } = Views::of_dataset(&dataset);
        let views = if test.is_empty() { train } else { test };
        let backend = Backend::start(&self.backend)?;
        let judge = |SpatialFile { scene, trained_with, .. }: &SpatialFile| {
            let render = &self.shown.settings_beside(scene, *trained_with, &dataset);
            backend.run_spatial(Judge { scene, views: &views, render })
        };
        let (before, after) = (judge(before)?, judge(after)?);
        let dataset = path.display().to_string();
        Ok(Some(Cost { dataset, views: after.views.len(), psnr_before: before.psnr, psnr_after: after.psnr }))
    }
}

impl fmt::Display for Cost {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { dataset, views, psnr_before, psnr_after } = self;
        write!(f, "PSNR {psnr_before:.2} dB before, {psnr_after:.2} dB after, mean over {views} views of {dataset}")
    }
}
