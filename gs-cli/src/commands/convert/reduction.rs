//! `gs convert --gaussians`: fewer Gaussians, and what that costs.

use std::fmt;

use gs_backend::FutureExt as _;
use gs_core::{Camera, Rasterizer as _, Scene as _, counted, metrics::l1_and_psnr, view::Orbit};
use gs_io::{File3d, dataset::Dataset};
use gs_train::limits;
use serde::Serialize;

use super::quality::QualityArgs;
use crate::{
    failure::Failure,
    flags::{cameras::Home, values::Size},
};

/// Cameras of the ring around a scene without a data set.
const RING: u32 = 16;

/// Size of their images.
const RING_SIZE: Size = Size { width: 640, height: 480 };

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

/// Reduces a scene.
pub(super) fn reduce(
    file: &mut File3d,
    count: u32,
    dataset: Option<&Dataset>,
    args: &QualityArgs,
) -> Result<Reduction, Failure> {
    let cameras: Vec<Camera> = match dataset {
        Some(dataset) => dataset.views.iter().map(|view| view.camera).collect(),
        None => {
            let Home { camera, target, up } = Home::of(file, Some(RING_SIZE), None)?;
            Orbit { center: target, axis: up, frames: RING }.cameras(&camera)
        }
    };
    let rasterizer = args.open()?;
    let render = args.render.settings(file, dataset);
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
    Ok(Reduction { from, to: file.scene.len(), merged, removed, cameras: cameras.len(), psnr_against_before: psnr })
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
