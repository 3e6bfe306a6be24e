//! What a conversion costs: how close the scene comes to a data set's images before it and after.

use std::{fmt, path::PathBuf};

use clap::Args;
use gs_core::counted;
use gs_io::{
    File3d, TrainedWith,
    dataset::{Dataset, read_dataset},
};
use gs_train::train::Views;
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
    /// Reads the data set to judge by, if there is one: before anything is written.
    ///
    /// # Errors
    /// Where it cannot be read, or a flag says how to show a scene that is not judged.
    pub(super) fn dataset(&self) -> Result<Option<Dataset>, Failure> {
        match &self.dataset {
            Some(path) => Ok(Some(read_dataset(path, &self.photographs.settings())?)),
            None if self.shown.is_of_pictures() => {
                Err(Failure::usage("--background and --sh-degree are for judging a scene").mend("add --dataset"))
            }
            None => Ok(None),
        }
    }

    /// How the scene was trained: as flags say, otherwise as its file does.
    pub(super) fn trained_with(&self, file: TrainedWith) -> TrainedWith {
        self.shown.trained_with(file)
    }

    /// Judges both scenes, each shown as its file says.
    ///
    /// # Errors
    /// Where an image cannot be read or the backend fails.
    pub(super) fn measure(&self, dataset: &Dataset, before: &File3d, after: &File3d) -> Result<Cost, Failure> {
        let Views { train, test, .. } = Views::of_dataset(dataset);
        let views = if test.is_empty() { train } else { test };
        let backend = Backend::start(&self.backend)?;
        let judge = |File3d { scene, trained_with, .. }: &File3d| {
            let render = &self.shown.settings_beside(scene, *trained_with, dataset);
            backend.run_3d(Judge { scene, views: &views, render })
        };
        let (before, after) = (judge(before)?, judge(after)?);
        let dataset = self.dataset.iter().map(|path| path.display().to_string()).collect();
        Ok(Cost { dataset, views: after.views.len(), psnr_before: before.psnr, psnr_after: after.psnr })
    }
}

impl fmt::Display for Cost {
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
