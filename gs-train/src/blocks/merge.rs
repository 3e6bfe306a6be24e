//! The result of all blocks.

use gs_core::{
    Camera, Image, Output, Parameterization, Rasterizer, RenderSettings, Scene as _, Scene3d,
    examination::Examinable as _,
    metrics::{mean, psnr_of_mse},
};
use serde::{Deserialize, Serialize};

use super::plan::BlocksPlan;
use crate::{
    error::Error,
    train::{Evaluation, PosedView, evaluate as evaluate_views, plain},
};

/// The Gaussians of a block's trained scene that belong to the block: those that were not fixed and whose means lie in
/// its cell.
///
/// # Panics
/// Where there is no such block.
pub fn own(plan: &BlocksPlan, block: usize, mut scene: Scene3d) -> Scene3d {
    let (fixed, cell) = (plan.blocks[block].fixed as usize, plan.blocks[block].cell);
    let is_own = |index: usize| index >= fixed && cell.contains(plan.ground.place(scene.means[index]));
    let keep: Vec<bool> = (0..scene.len()).map(is_own).collect();
    scene.retain(&keep);
    scene
}

/// Quality over the held-out views to which a block contributes most.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct BlockQuality {
    /// Number of these views.
    pub views: usize,
    /// Mean of their PSNR, dB; `None` without such views.
    pub psnr: Option<f64>,
    /// Mean of their SSIM.
    pub ssim: Option<f64>,
}

/// Quality over the pixels of all held-out views that show places [near](super::BlockPlan::near) the edge of a cell,
/// and over all others.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Edges {
    /// Number of pixels near an edge.
    pub pixels: u64,
    /// PSNR of all pixels near an edge together, dB; `None` without any.
    pub near: Option<f64>,
    /// PSNR of all other pixels together, dB.
    pub rest: Option<f64>,
}

/// Quality of a merged scene.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct BlocksEvaluation {
    /// Quality over all held-out views.
    #[serde(flatten)]
    pub whole: Evaluation,
    /// Quality by block.
    pub blocks: Vec<BlockQuality>,
    /// Quality near the edges of the cells.
    pub edges: Edges,
    /// The held-out view that shows most of what is near edges: its image, its rendering, and 4 times the
    /// difference of both around mid-grey, darker where nothing is near an edge; `None` without such a view.
    #[serde(skip)]
    pub seams: Option<Image>,
}

/// Evaluates a scene on the held-out views, all together, by block, and near the edges of the cells. What is near an
/// edge follows from the depths of `merged`, so that several scenes can be compared at the same pixels.
///
/// # Errors
/// Those of [`train::evaluate`](crate::train::evaluate); [`Error::OtherViews`] for other views than those of the plan.
pub async fn evaluate<R: Rasterizer<Scene3d>>(
    on: &R,
    plan: &BlocksPlan,
    (scene, merged): (&Scene3d, &Scene3d),
    views: &[PosedView],
    render: &RenderSettings,
) -> Result<BlocksEvaluation, Error> {
    if views.len() != plan.held_out.len() {
        return Err(Error::OtherViews { expected: plan.held_out.len(), found: views.len() });
    }
    let whole = evaluate_views(on, scene, views, render).await?;
    let of_block = |block: usize| {
        let names = || views.iter().zip(&plan.held_out).filter(|(_, most)| **most == block).map(|(view, _)| &view.name);
        let measured = whole.views.iter().filter(|view| names().any(|name| *name == view.name));
        let (psnr, ssim): (Vec<f64>, Vec<f64>) = measured.map(|view| (view.psnr, view.ssim)).unzip();
        let some = |values: Vec<f64>| (!values.is_empty()).then(|| mean(values));
        BlockQuality { views: psnr.len(), psnr: some(psnr), ssim: some(ssim) }
    };
    let blocks = (0..plan.blocks.len()).map(of_block).collect();
    let (edges, seams) = near_edges(on, plan, (scene, merged), views, render).await?;
    Ok(BlocksEvaluation { whole, blocks, edges, seams })
}

/// Pixels are near an edge if the ground below what they show is near the cells of two blocks.
async fn near_edges<R: Rasterizer<Scene3d>>(
    on: &R,
    plan: &BlocksPlan,
    (scene, merged): (&Scene3d, &Scene3d),
    views: &[PosedView],
    render: &RenderSettings,
) -> Result<(Edges, Option<Image>), Error> {
    let [splats, merged] = [
        on.upload(scene, Parameterization::ScaleRotation)?,
        on.upload(&plain(merged), Parameterization::ScaleRotation)?,
    ];
    let covered = render.of_alpha().with(|s| s.effects.sh_degree = 0);
    let inverse = covered.with(|s| s.output = Output::InverseDepth);
    // Squared errors and numbers of pixels: the rest, and near an edge.
    let mut sums = [(0.0, 0_u64); 2];
    let (mut most, mut seams) = (0, None);
    for view in views {
        let (image, _) = on.draw(&splats, &view.camera, render).await?;
        let (alpha, _) = on.draw(&merged, &view.camera, &covered).await?;
        let (inverse, _) = on.draw(&merged, &view.camera, &inverse).await?;
        let (image, posed) = (image.rounded_to_8_bits(), view.image()?);
        let mask = posed.mask.clone();
        let target = posed.over(render.background_color())?.clamped();
        let near: Vec<bool> = (0..target.pixels().len())
            .map(|index| {
                let depth = alpha.pixels()[index][0] / inverse.pixels()[index][0];
                let counts = mask.as_ref().is_none_or(|mask| mask[index]);
                counts && depth.is_finite() && depth > 0.0 && is_near(plan, &view.camera, index, depth)
            })
            .collect();
        for (index, (found, wanted)) in image.pixels().iter().zip(target.pixels()).enumerate() {
            if mask.as_ref().is_some_and(|mask| !mask[index]) {
                continue;
            }
            let sum = &mut sums[usize::from(near[index])];
            sum.0 += found.iter().zip(wanted).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / 3.0;
            sum.1 += 1;
        }
        let shown = near.iter().filter(|near| **near).count();
        if shown > most {
            (most, seams) = (shown, Some(picture_of_seams(&target, &image, &near)?));
        }
    }
    let [rest, near] = sums.map(|(sum, pixels)| (pixels > 0).then(|| psnr_of_mse(sum / pixels as f64)));
    Ok((Edges { pixels: sums[1].1, near, rest }, seams))
}

fn picture_of_seams(target: &Image, image: &Image, near: &[bool]) -> Result<Image, Error> {
    let (width, height) = target.size();
    let picture = Image::from_fn(3 * width, height, |x, y| {
        let (wanted, found) = (target.pixel(x % width, y), image.pixel(x % width, y));
        let light = if near[(y * width + x % width) as usize] { 1.0 } else { 0.4 };
        match x / width {
            0 => wanted,
            1 => found,
            _ => [0, 1, 2].map(|c| light * (0.5 + 4.0 * (found[c] - wanted[c])).clamp(0.0, 1.0)),
        }
    });
    Ok(picture?)
}

fn is_near(plan: &BlocksPlan, camera: &Camera, index: usize, depth: f32) -> bool {
    let (x, y) = (index as u32 % camera.width, index as u32 / camera.width);
    let at = (glam::Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - camera.center) / camera.focal;
    let point = camera.rotation.transpose() * (at.extend(1.0) * depth - camera.translation);
    let place = plan.ground.place(point);
    plan.blocks.iter().filter(|block| block.near.contains(place)).count() > 1
}
