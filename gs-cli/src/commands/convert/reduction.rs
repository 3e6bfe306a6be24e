//! `gs convert --gaussians`: fewer Gaussians, and what that costs.

use std::{fmt, path::PathBuf};

use clap::Args;
use gs_backend::FutureExt as _;
use gs_core::{Camera, Rasterizer as _, Scene as _, counted, metrics::l1_and_psnr, view::Orbit};
use gs_io::{File3d, dataset::Dataset};
use gs_train::limits;
use serde::Serialize;

use crate::{
    failure::Failure,
    flags::{
        backend::BackendArgs,
        cameras::Home,
        dataset::DatasetArgs,
        render_args::RenderArgs3d,
        values::{Size, whole},
    },
};

/// Cameras of the ring around a scene without a data set.
const RING: u32 = 16;

/// Size of their images.
const RING_SIZE: Size = Size { width: 640, height: 480 };

/// The flags for reducing a scene. Except for order and antialiasing, they need `--gaussians`.
#[derive(Debug, Clone, Args)]
pub(super) struct ReductionArgs {
    /// Reduce a 3D scene to N Gaussians: those that contribute least to the views of the data set, or
    /// to a ring of cameras, are merged into neighbours or removed; prints what that costs in dB
    #[arg(short = 'n', long, value_name = "N", value_parser = whole::<u32>(1..))]
    pub(super) gaussians: Option<u32>,
    /// Data set whose views --gaussians looks at
    #[arg(long, value_name = "DATASET", requires = "gaussians")]
    dataset: Option<PathBuf>,
    #[command(flatten)]
    images: DatasetArgs,
    #[command(flatten)]
    pub(super) render: RenderArgs3d,
    #[command(flatten)]
    backend: BackendArgs,
}

/// What was merged and removed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Reduction {
    from: usize,
    to: usize,
    merged: usize,
    removed: usize,
    /// Number of cameras.
    cameras: usize,
    /// Mean PSNR of the images afterwards against those before, dB.
    psnr_against_before: f64,
}

impl Reduction {
    /// Number of Gaussians that are no longer there.
    pub(super) fn fewer(&self) -> usize {
        self.from - self.to
    }
}

impl ReductionArgs {
    /// Reads the data set, if there is one, in the frame of the scene.
    pub(super) fn dataset(&self, scene: &File3d) -> Result<Option<Dataset>, Failure> {
        self.dataset.as_deref().map(|path| self.images.read_for(scene, path)).transpose()
    }

    /// Reduces a scene, if that is asked for.
    pub(super) fn reduce(&self, file: &mut File3d, dataset: Option<&Dataset>) -> Result<Option<Reduction>, Failure> {
        let Some(count) = self.gaussians else { return Ok(None) };
        let cameras: Vec<Camera> = match dataset {
            Some(dataset) => dataset.views.iter().map(|view| view.camera).collect(),
            None => {
                let Home { camera, target, up } = Home::of(&file.scene, Some(RING_SIZE), None)?;
                Orbit { center: target, axis: up, frames: RING }.cameras(&camera)
            }
        };
        let rasterizer = self.backend.open()?.rasterizer;
        let render = self.render.settings(file, dataset);
        let reduced = limits::reduce(&rasterizer, &file.scene, &cameras, &render, count as usize).block_on()?;
        let mut psnr = 0.0;
        for camera in &cameras {
            let image = |scene| rasterizer.for_3d().render(scene, camera, &render).block_on();
            let (before, after) = (image(&file.scene)?, image(&reduced.scene)?);
            psnr += l1_and_psnr(&after, &before)?.1 / cameras.len() as f64;
        }
        let from = file.scene.len();
        file.scene = reduced.scene;
        let (merged, removed) = (reduced.merged, reduced.removed);
        Ok(Some(Reduction {
            from,
            to: file.scene.len(),
            merged,
            removed,
            cameras: cameras.len(),
            psnr_against_before: psnr,
        }))
    }
}

impl fmt::Display for Reduction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { from, to, merged, removed, cameras, psnr_against_before } = self;
        let psnr = match psnr_against_before.is_finite() {
            true => format!("{psnr_against_before:.2} dB"),
            false => "no difference".to_owned(),
        };
        write!(
            f,
            "{from} to {to} Gaussians: {merged} merged into others, {removed} removed; {psnr} against the scene before, \
             mean over {}",
            counted(*cameras, "camera")
        )
    }
}
