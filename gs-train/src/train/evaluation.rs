//! Evaluation of a 3D scene, view by view: PSNR, SSIM, MS-SSIM and mean absolute difference of its
//! 8-bit renderings.

use gs_core::{
    Culled, Image, Parameterization, Rasterizer, RenderSettings, Scene3d,
    metrics::{self, Comparison, compare, l1_and_psnr, mean, psnr_of_mse},
};
use gs_io::dataset::PosedImage;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::poses::align::{self, Half};
use crate::views::{ColorMap, PosedView};
use crate::{error::Error, memory::evaluated_at_once, run::infinite_where_null};

/// Quality where differences in exposure and white balance do not count: an affine map of colours
/// is fitted from the left half of the 8-bit rendering to that of the image, and the right half is
/// measured with it.
///
/// *Source:* the rule for views without a trained appearance of NeRF in the Wild (Martin-Brualla et
/// al. 2021), with a map of colours in place of a code.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub struct ColorMatched {
    /// PSNR over the pixels of the right half that count, dB; ∞ for equal images, which JSON writes
    /// as `null`.
    #[serde(deserialize_with = "infinite_where_null")]
    pub psnr: f64,
    /// Structural similarity of the right half.
    pub ssim: f64,
}

/// Quality where errors of a view's pose do not count: the camera is aligned to the left half of its image,
/// and the right half of the rendering from there is measured.
///
/// *Source:* as for [`ColorMatched`]; cameras are aligned as in direct visual odometry (Kerl et al. 2013).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub struct PoseMatched {
    /// PSNR over the pixels of the right half that count, dB; ∞ for equal images, which JSON writes
    /// as `null`.
    #[serde(deserialize_with = "infinite_where_null")]
    pub psnr: f64,
    /// Structural similarity of the right half.
    pub ssim: f64,
    /// Mean absolute difference over the pixels of the right half that count.
    pub l1: f64,
}

/// Quality of one view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub struct ViewQuality {
    /// Name of the view.
    pub name: String,
    /// PSNR over the pixels that count, dB; ∞ for equal images, which JSON writes as `null`.
    #[serde(deserialize_with = "infinite_where_null")]
    pub psnr: f64,
    /// Structural similarity. Pixels that do not count are replaced by the rendering.
    pub ssim: f64,
    /// Multi-scale structural similarity, likewise; `None` where a side is shorter than 161 px, too
    /// small for its five scales.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ms_ssim: Option<f64>,
    /// Mean absolute difference over the pixels that count.
    pub l1: f64,
    /// Quality with matched colours; `None` where no pixel of one half counts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub color_matched: Option<ColorMatched>,
    /// Quality at the aligned pose, where poses are matched; `None` where no pixel of the right half counts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose_matched: Option<PoseMatched>,
}

/// Quality of a scene over several views.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub struct Evaluation {
    /// Mean of the views' PSNR, dB.
    #[serde(deserialize_with = "infinite_where_null")]
    pub psnr: f64,
    /// Mean of their SSIM.
    pub ssim: f64,
    /// Mean of their MS-SSIM, over the views that are large enough for it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ms_ssim: Option<f64>,
    /// Mean of their mean absolute differences.
    pub l1: f64,
    /// Means of the views' quality with matched colours.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub color_matched: Option<ColorMatched>,
    /// Means of the views' quality at aligned poses.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose_matched: Option<PoseMatched>,
    /// Gaussians that the renderings left out, summed over the views.
    pub culled: Culled,
    /// Quality of each view in which some pixel counts.
    pub views: Vec<ViewQuality>,
    /// Names of the views whose masks leave out every pixel. They are in no mean.
    #[serde(default)]
    pub unmeasured: Vec<String>,
}

/// Quality over training views.
///
/// It is measured on an evenly spread sample: as many views as are held out, at most 32, or 8 where
/// none is held out.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub struct TrainingViews {
    /// Number of views in which some pixel counts.
    pub views: usize,
    /// Mean of their PSNR, dB; `None` without such views; ∞, which JSON writes as `null`, where all
    /// are exact.
    pub psnr: Option<f64>,
    /// Mean loss at full resolution, in the unit of
    /// [`TrainSettings::loss`](super::TrainSettings::loss).
    pub loss: f32,
}

/// An 8-bit rendering and its target before the same background, with rendered pixels where the
/// mask leaves them out.
pub(crate) struct Pair {
    rendered: Image,
    target: Image,
    /// Number of pixels per pixel that counts.
    share: f64,
}

/// Pairs a rendering with its image; `None` where no pixel counts.
pub(crate) fn measure(rendered: &Image, posed: PosedImage, background: [f32; 3]) -> Result<Option<Pair>, Error> {
    paired(rendered.rounded_to_8_bits(), posed, background)
}

/// [`measure`] of a rendering that is rounded.
fn paired(rendered: Image, posed: PosedImage, background: [f32; 3]) -> Result<Option<Pair>, Error> {
    let mask = posed.mask.clone();
    let target = posed.over(background)?.clamped();
    let (target, share) = match mask {
        None => (target, 1.0),
        Some(mask) => {
            let counted = mask.iter().filter(|counts| **counts).count();
            if counted == 0 {
                return Ok(None);
            }
            (where_masked(target, &mask, &rendered), mask.len() as f64 / counted as f64)
        }
    };
    Ok(Some(Pair { rendered, target, share }))
}

/// Variance of colours that say nothing about the map of a view: half a level of 255.
const PRIOR: f64 = 4e-6;

/// Quality with matched colours of a rendering that is rounded; `None` where no pixel of one half counts.
fn color_matched(rendered: &Image, posed: &PosedImage, background: [f32; 3]) -> Result<Option<ColorMatched>, Error> {
    let target = posed.clone().over(background)?;
    let (width, middle) = (target.width() as usize, target.width() / 2);
    let is_left = |index: &usize| index % width < middle as usize;
    let counts = |index: &usize| posed.mask.as_ref().is_none_or(|mask| mask[*index]);
    let known = (0..target.pixels().len()).filter(is_left).filter(counts);
    let pairs: Vec<_> = known.map(|index| (rendered.pixels()[index], target.pixels()[index])).collect();
    if pairs.is_empty() {
        return Ok(None);
    }
    let map = ColorMap::fit(&pairs, PRIOR);
    let measured = of_half(Half::Right, rendered, posed, background, |right| map.image(&right))?;
    Ok(measured.map(|PoseMatched { psnr, ssim, .. }| ColorMatched { psnr, ssim }))
}

/// Quality of a half of a rendering after a change; `None` where none of its pixels counts.
pub(super) fn of_half(
    half: Half,
    rendered: &Image,
    posed: &PosedImage,
    background: [f32; 3],
    change: impl Fn(Image) -> Image,
) -> Result<Option<PoseMatched>, Error> {
    let target = posed.clone().over(background)?;
    let width = target.width() as usize;
    let columns = half.columns(width);
    let part = |image: &Image| {
        let rows = (0..image.height()).map(|y| &image.row(y)[columns.clone()]);
        Image::from_pixels(columns.len() as u32, image.height(), rows.collect::<Vec<_>>().concat())
    };
    let of_mask =
        |mask: &Vec<bool>| (0..mask.len()).filter(|i| columns.contains(&(i % width))).map(|i| mask[i]).collect();
    let posed = PosedImage { image: part(&target)?, alpha: None, mask: posed.mask.as_ref().map(of_mask) };
    let Some(pair) = measure(&change(part(rendered)?), posed, background)? else { return Ok(None) };
    let ((l1, psnr), ssim) = (pair.l1_and_psnr()?, metrics::ssim(&pair.rendered, &pair.target)?);
    Ok(Some(PoseMatched { psnr, ssim, l1 }))
}

impl Pair {
    pub(crate) fn l1_and_psnr(&self) -> Result<(f64, f64), Error> {
        let (l1, psnr) = l1_and_psnr(&self.rendered, &self.target)?;
        Ok((l1 * self.share, psnr + psnr_of_mse(self.share)))
    }
}

/// Evaluates a scene on views, rendered with these settings.
///
/// # Errors
/// Those of the backend and of reading an image; [`gs_core::Error::Setting`] without a view, and
/// [`Error::NothingCounts`] where the masks of all views leave out every pixel.
pub async fn evaluate<R: Rasterizer<Scene3d>>(
    rasterizer: &R,
    scene: &Scene3d,
    views: &[PosedView],
    render: &RenderSettings,
) -> Result<Evaluation, Error> {
    let splats = rasterizer.upload(scene, Parameterization::ScaleRotation)?;
    let views = views.iter().collect::<Vec<_>>();
    evaluate_splats(rasterizer, &splats, (&views, Matching::Colors), render, &|_, _, _| Ok(())).await
}

/// [`evaluate`], also at poses that are aligned to the left halves of the images ([`PoseMatched`]).
///
/// # Errors
/// Those of [`evaluate`].
pub async fn evaluate_aligned<R: Rasterizer<Scene3d>>(
    rasterizer: &R,
    scene: &Scene3d,
    views: &[PosedView],
    render: &RenderSettings,
) -> Result<Evaluation, Error> {
    let splats = rasterizer.upload(scene, Parameterization::ScaleRotation)?;
    let views = views.iter().collect::<Vec<_>>();
    evaluate_splats(rasterizer, &splats, (&views, Matching::Poses), render, &|_, _, _| Ok(())).await
}

/// What is matched on the left halves of views.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Matching {
    /// Only colours.
    Colors,
    /// Also poses.
    Poses,
}

/// Receives views of an evaluation on several threads: the number of a view, its image and its
/// rendering, not clamped; where poses are matched, the rendering from the aligned pose.
pub type Look<'a> = dyn Fn(usize, &PosedImage, &Image) -> Result<(), Error> + Sync + 'a;

/// [`evaluate`] for splats. Some views are rendered, one after the other; then they are measured at the
/// same time, a thread for each.
pub(super) async fn evaluate_splats<R: Rasterizer<Scene3d>>(
    rasterizer: &R,
    splats: &R::Splats,
    (views, matching): (&[&PosedView], Matching),
    render: &RenderSettings,
    look: &Look<'_>,
) -> Result<Evaluation, Error> {
    gs_core::Error::within("the number of test views", views.len(), 1.., "at least 1")?;
    let mut culled = Culled::default();
    let (mut qualities, mut unmeasured) = (Vec::with_capacity(views.len()), Vec::new());
    let together = together(views.iter().copied());
    for (number, batch) in views.chunks(together).enumerate() {
        let first = number * together;
        views[first..].iter().take(2 * together).for_each(|next| next.source.read_ahead());
        let mut renderings = Vec::with_capacity(batch.len());
        for view in batch {
            let (rendered, left_out) = rasterizer.draw(splats, &view.camera, render).await?;
            culled = culled.plus(left_out);
            let aligned = match matching {
                Matching::Colors => None,
                Matching::Poses => Some(draw_aligned((rasterizer, splats), view, render).await?),
            };
            renderings.push((rendered, aligned));
        }
        let measured = batch.par_iter().zip(renderings).enumerate().map(|(place, (view, (rendered, aligned)))| {
            let (posed, background) = (view.image()?, render.background_color());
            look(first + place, &posed, aligned.as_ref().unwrap_or(&rendered))?;
            let at_pose = |aligned: Image| of_half(Half::Right, &aligned, &posed, background, |right| right);
            let pose_matched = aligned.map(at_pose).transpose()?.flatten();
            let quality = quality_of(&view.name, rendered, posed, background)?;
            Ok::<_, Error>(quality.map(|quality| ViewQuality { pose_matched, ..quality }))
        });
        // The first error, whichever thread was faster.
        for (view, quality) in batch.iter().zip(measured.collect::<Vec<_>>()) {
            match quality? {
                Some(quality) => qualities.push(quality),
                None => unmeasured.push(view.name.clone()),
            }
        }
    }
    if qualities.is_empty() {
        return Err(Error::NothingCounts { views: views.len() });
    }
    let mean = |of: fn(&ViewQuality) -> f64| mean(qualities.iter().map(of));
    let (psnr, ssim, l1) = (mean(|v| v.psnr), mean(|v| v.ssim), mean(|v| v.l1));
    let matched: Vec<ColorMatched> = qualities.iter().filter_map(|view| view.color_matched).collect();
    let color_matched = (!matched.is_empty()).then(|| ColorMatched {
        psnr: metrics::mean(matched.iter().map(|m| m.psnr)),
        ssim: metrics::mean(matched.iter().map(|m| m.ssim)),
    });
    let at_poses: Vec<PoseMatched> = qualities.iter().filter_map(|view| view.pose_matched).collect();
    let pose_matched = (!at_poses.is_empty()).then(|| PoseMatched {
        psnr: metrics::mean(at_poses.iter().map(|m| m.psnr)),
        ssim: metrics::mean(at_poses.iter().map(|m| m.ssim)),
        l1: metrics::mean(at_poses.iter().map(|m| m.l1)),
    });
    let ms_ssims: Vec<f64> = qualities.iter().filter_map(|view| view.ms_ssim).collect();
    let ms_ssim = (!ms_ssims.is_empty()).then(|| metrics::mean(&ms_ssims));
    Ok(Evaluation { psnr, ssim, ms_ssim, l1, color_matched, pose_matched, culled, views: qualities, unmeasured })
}

/// The rendering of a view whose camera is aligned to the left half of its image.
async fn draw_aligned<R: Rasterizer<Scene3d>>(
    scene: (&R, &R::Splats),
    view: &PosedView,
    render: &RenderSettings,
) -> Result<Image, Error> {
    let camera = align::to_left_half(scene, view, render).await?;
    Ok(scene.0.draw(scene.1, &camera, render).await?.0)
}

/// The target with rendered pixels where the mask leaves them out.
pub(super) fn where_masked(mut target: Image, mask: &[bool], rendered: &Image) -> Image {
    for ((pixel, &counts), &rendered) in target.pixels_mut().iter_mut().zip(mask).zip(rendered.pixels()) {
        if !counts {
            *pixel = rendered;
        }
    }
    target
}

/// Number of these views to measure at the same time.
pub(super) fn together<'a>(views: impl IntoIterator<Item = &'a PosedView>) -> usize {
    let pixels = |view: &PosedView| u64::from(view.camera.width) * u64::from(view.camera.height);
    evaluated_at_once(views.into_iter().map(pixels).max().unwrap_or(0))
}

/// Quality of a view; `None` where no pixel counts.
fn quality_of(
    name: &str,
    rendered: Image,
    posed: PosedImage,
    background: [f32; 3],
) -> Result<Option<ViewQuality>, Error> {
    let rendered = rendered.rounded_to_8_bits();
    let color_matched = color_matched(&rendered, &posed, background)?;
    let Some(pair) = paired(rendered, posed, background)? else { return Ok(None) };
    // The bits of what is measured during a training.
    let (l1, psnr) = pair.l1_and_psnr()?;
    let Comparison { ssim, ms_ssim, .. } = compare(&pair.rendered, &pair.target, false)?;
    Ok(Some(ViewQuality { name: name.to_owned(), psnr, ssim, ms_ssim, l1, color_matched, pose_matched: None }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_counts_is_measured() {
        let level = 128.0 / 255.0;
        let rendered = Image::filled(4, 4, [level; 3]).unwrap();
        let image = Image::from_fn(4, 4, |x, _| if x < 2 { [level + 0.1; 3] } else { [0.0; 3] }).unwrap();
        let mask: Vec<bool> = (0..16).map(|i| i % 4 < 2).collect();
        let posed = PosedImage { image, alpha: None, mask: Some(mask) };
        let masked = measure(&rendered, posed.clone(), [0.0; 3]).unwrap().unwrap().l1_and_psnr().unwrap();
        assert!((masked.0 - 0.1).abs() < 1e-6 && (masked.1 - 20.0).abs() < 1e-4, "{masked:?}");
        let nothing = PosedImage { mask: Some(vec![false; 16]), ..posed };
        assert!(measure(&rendered, nothing, [0.0; 3]).unwrap().is_none());
    }

    #[test]
    fn transparent_pixels_show_the_background() {
        let rendered = Image::filled(3, 3, [1.0; 3]).unwrap();
        let image = Image::filled(3, 3, [0.0; 3]).unwrap();
        let glass = PosedImage { image, alpha: Some(vec![0.0; 9]), mask: None };
        let pair = measure(&rendered, glass, [1.0; 3]).unwrap().unwrap();
        assert_eq!(pair.l1_and_psnr().unwrap(), (0.0, f64::INFINITY));
    }

    #[test]
    fn masked_pixels_are_as_rendered() {
        let target = Image::filled(2, 1, [1.0; 3]).unwrap();
        let rendered = Image::filled(2, 1, [0.25; 3]).unwrap();
        let masked = where_masked(target, &[true, false], &rendered);
        assert_eq!(masked.pixels(), [[1.0; 3], [0.25; 3]]);
    }
}
