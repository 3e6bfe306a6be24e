//! How good a scene is, view by view: PSNR, SSIM and mean absolute difference of its renderings as they are written in 8 bits.

use gs_core::{
    Image, Parameterization, Rasterizer, RenderSettings, Scene3d,
    metrics::{self, mean},
    statistics::Culled,
};
use gs_io::dataset::PosedImage;
use serde::{Deserialize, Serialize};

use super::{task::where_masked, views::PosedView};
use crate::{error::Error, quality::l1_and_psnr, summary::infinite_where_null};

/// How good one view is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct ViewQuality {
    /// The view.
    pub name: String,
    /// dB, over the pixels that count; ∞ for equal images, which JSON writes as `null`.
    #[serde(deserialize_with = "infinite_where_null")]
    pub psnr: f64,
    /// Structural similarity. Pixels that do not count are as they are rendered.
    pub ssim: f64,
    /// Mean absolute difference over the pixels that count.
    pub l1: f64,
}

/// How good a scene is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Evaluation {
    /// Mean of the views' PSNR, dB.
    #[serde(deserialize_with = "infinite_where_null")]
    pub psnr: f64,
    /// Mean of their SSIM.
    pub ssim: f64,
    /// Mean of their mean absolute differences.
    pub l1: f64,
    /// Gaussians that the renderings left out, all views together.
    pub culled: Culled,
    /// View by view, those of which some pixel counts.
    pub views: Vec<ViewQuality>,
    /// The views of which no pixel counts, because their masks leave out all. Nothing can be said of them, and they are in no mean.
    #[serde(default)]
    pub unmeasured: Vec<String>,
}

/// How well a scene fits the views that it was trained with, by a sample of them, evenly spread: as many as there are held-out views, 32 at
/// most, or 8 where none is held out.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct TrainingViews {
    /// Views of which some pixel counts.
    pub views: usize,
    /// Mean of their PSNR, dB. Nothing where no pixel of any counts; ∞, which JSON writes as `null`, where all are exact.
    pub psnr: Option<f64>,
    /// Mean loss at full resolution, in the unit of [`TrainSettings::loss`](super::TrainSettings::loss).
    pub loss: f32,
}

/// A rendering as it is written in 8 bits beside its photograph, which is before the same background, and as rendered where it does not count.
pub(super) struct Pair {
    rendered: Image,
    target: Image,
    /// Pixels in all per pixel that counts.
    share: f64,
}

/// Puts them side by side; `None` where no pixel counts.
pub(super) fn measure(rendered: &Image, photograph: PosedImage, background: [f32; 3]) -> Option<Pair> {
    let rendered = rendered.rounded_to_8_bits();
    let mask = photograph.mask.clone();
    let target = photograph.over(background).clamped();
    let (target, share) = match mask {
        None => (target, 1.0),
        Some(mask) => {
            let counted = mask.iter().filter(|counts| **counts).count();
            if counted == 0 {
                return None;
            }
            (where_masked(target, &mask, &rendered), mask.len() as f64 / counted as f64)
        }
    };
    Some(Pair { rendered, target, share })
}

impl Pair {
    pub(super) fn l1_and_psnr(&self) -> (f64, f64) {
        let (l1, psnr) = l1_and_psnr(&self.rendered, &self.target);
        (l1 * self.share, psnr - 10.0 * self.share.log10())
    }
}

/// Judges a scene by views; `render` is how it is shown.
///
/// # Errors
/// Those of the backend and of reading a photograph; [`gs_core::Error::Setting`] without a view, and [`Error::NothingCounts`] where no pixel
/// of any counts.
pub async fn evaluate<R: Rasterizer<Scene3d>>(
    rasterizer: &R,
    scene: &Scene3d,
    views: &[PosedView],
    render: &RenderSettings,
) -> Result<Evaluation, Error> {
    let splats = rasterizer.upload(scene, Parameterization::ScaleRotation)?;
    evaluate_splats(rasterizer, &splats, &views.iter().collect::<Vec<_>>(), render, &mut |_, _| Ok(())).await
}

/// The same for splats; `look` sees each view's rendering, unclamped.
pub(super) async fn evaluate_splats<R: Rasterizer<Scene3d>>(
    rasterizer: &R,
    splats: &R::Splats,
    views: &[&PosedView],
    render: &RenderSettings,
    look: &mut dyn FnMut(&PosedView, &Image) -> Result<(), Error>,
) -> Result<Evaluation, Error> {
    if views.is_empty() {
        return Err(gs_core::Error::setting("the number of views to judge by", 0, "at least 1").into());
    }
    let mut culled = Culled::default();
    let (mut qualities, mut unmeasured) = (Vec::with_capacity(views.len()), Vec::new());
    for view in views {
        let (rendered, left_out) = rasterizer.draw(splats, &view.camera, render).await?;
        culled = culled.plus(left_out);
        look(view, &rendered)?;
        let Some(pair) = measure(&rendered, view.photograph()?, render.background_color()) else {
            unmeasured.push(view.name.clone());
            continue;
        };
        let (l1, psnr) = pair.l1_and_psnr();
        let ssim = metrics::ssim(&pair.rendered, &pair.target)?;
        qualities.push(ViewQuality { name: view.name.clone(), psnr, ssim, l1 });
    }
    if qualities.is_empty() {
        return Err(Error::NothingCounts { views: views.len() });
    }
    let mean = |of: fn(&ViewQuality) -> f64| mean(qualities.iter().map(of));
    let (psnr, ssim, l1) = (mean(|v| v.psnr), mean(|v| v.ssim), mean(|v| v.l1));
    Ok(Evaluation { psnr, ssim, l1, culled, views: qualities, unmeasured })
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
        let photograph = PosedImage { image, alpha: None, mask: Some(mask) };
        let masked = measure(&rendered, photograph.clone(), [0.0; 3]).unwrap().l1_and_psnr();
        assert!((masked.0 - 0.1).abs() < 1e-6 && (masked.1 - 20.0).abs() < 1e-4, "{masked:?}");
        let nothing = PosedImage { mask: Some(vec![false; 16]), ..photograph };
        assert!(measure(&rendered, nothing, [0.0; 3]).is_none());
    }

    #[test]
    fn transparent_pixels_show_the_background() {
        let rendered = Image::filled(3, 3, [1.0; 3]).unwrap();
        let image = Image::filled(3, 3, [0.0; 3]).unwrap();
        let glass = PosedImage { image, alpha: Some(vec![0.0; 9]), mask: None };
        assert_eq!(measure(&rendered, glass, [1.0; 3]).unwrap().l1_and_psnr(), (0.0, f64::INFINITY));
    }
}
