//! The depth loss: inverse depths of the scene are compared with the depth maps of the training
//! views.
//!
//! A step renders the inverse depths of its view once more, at half the resolution of the step, and
//! adds the gradients of mean |1/z − 1/ẑ| to its own. *Source:* the depth regularization of Kerbl et
//! al. 2024, *A Hierarchical 3D Gaussian Representation for Real-Time Rendering of Very Large
//! Datasets*. Here the loss is relative to the mean inverse depth of the map, so that its weight
//! does not depend on the unit of the world.
//!
//! The scale and shift of a map are fitted to the first Gaussians, if these are on surfaces.
//! Otherwise a map in world units is used as it is, and any other is fitted to the renderings of its
//! view a few times in the run.

use std::collections::BTreeMap;

use glam::Vec3;
use gs_core::{
    Camera, Image, Loss, Optimizer, Output, RenderSettings, Scene3d, TargetImage,
    effects::{Background, Statistics},
};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::run::{table, to_table};
use crate::{
    start::searched_camera,
    views::{Fit, Images, PosedView, Sample, fits, possible, reduced_camera, samples, training_image, values_at},
};

gs_core::impl_with!(DepthLoss);

/// Divisor of the step's resolution at which depths are compared. They vary less than colours.
const COARSER: u32 = 2;

/// Shares of a run after which maps are fitted to renderings.
const FITTED_AT: [f64; 3] = [0.2, 0.35, 0.5];

/// Side of the cells of an image for [`samples`], px, and distance between the pixels of a rendering
/// that a map is fitted to.
const CELL: u32 = 6;

/// Least opacity of a rendered pixel whose depth counts.
const LEAST_OPACITY: f32 = 0.9;

/// Key of the fits in the metadata of checkpoints.
const KEY: &str = "depth-maps";

/// Weight of the depth maps of training views in the loss.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub struct DepthLoss {
    /// Weight in the first step, at least 0. With 0, depth maps are not part of the loss. Default 0.
    pub weight: f32,
    /// The weight in the last step as a share of that in the first, above 0 and at most 1; it falls
    /// exponentially. Default 0.01 (Kerbl et al. 2024).
    pub decay: f32,
}

impl Default for DepthLoss {
    fn default() -> Self {
        Self { weight: 0.0, decay: 0.01 }
    }
}

impl DepthLoss {
    /// A weight for runs of minutes: that of Kerbl et al. 2024.
    pub const USUAL_WEIGHT: f32 = 1.0;

    /// Whether depth maps are not part of the loss.
    pub(crate) fn is_off(&self) -> bool {
        self.weight == 0.0
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// [`gs_core::Error::Setting`] naming the first value outside its range.
    pub(crate) fn validate(&self) -> Result<(), gs_core::Error> {
        gs_core::Error::within("depth-loss.weight", self.weight, 0.0..=f32::MAX, "at least 0 and finite")?;
        gs_core::Error::within("depth-loss.decay", self.decay, f32::MIN_POSITIVE..=1.0, "above 0 and at most 1")
    }

    /// The weight at `progress` in 0..=1 of the run.
    fn at(&self, progress: f32) -> f32 {
        self.weight * self.decay.powf(progress)
    }
}

/// Numbers of depth maps in the loss of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub struct DepthMapCounts {
    /// Training views with a depth map.
    pub maps: usize,
    /// Those whose map is in world units or could be fitted to the scene. Only these are used.
    pub used: usize,
}

/// The depth map of a training view.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct Guide {
    /// Index of the view.
    view: usize,
    /// Whether the fit stays for the whole run; other maps are fitted to renderings.
    fixed: bool,
    /// What the map's values mean; `None` where that is not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    fit: Option<Fit>,
}

/// The depth maps of a run's training views by ascending index, as stored in its checkpoints; none
/// where they are not part of the loss.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub(super) struct Guides {
    of_views: Vec<Guide>,
}

impl Guides {
    /// The depth maps of these views, fitted to the `known` positions.
    ///
    /// # Errors
    /// Those of reading a depth map.
    pub(super) fn of(views: &[PosedView], known: &[Vec3]) -> Result<Self, Error> {
        let read = |(index, view): (usize, &PosedView)| {
            let Some(map) = view.source.depth()? else { return Ok(None) };
            let camera = searched_camera(&view.camera);
            let samples = samples(&camera, &values_at(&map, &camera), CELL, known.iter().copied());
            Ok(Some((index, map.unit, samples)))
        };
        let found = views.par_iter().enumerate().map(read).collect::<Result<Vec<_>, Error>>()?;
        let (maps, samples): (Vec<_>, Vec<_>) =
            found.into_iter().flatten().map(|(view, unit, samples)| ((view, unit), samples)).unzip();
        let guide = |((view, unit), fit): ((usize, Option<f32>), Option<Fit>)| {
            let fit = fit.or_else(|| unit.map(Fit::in_units));
            Guide { view, fixed: fit.is_some(), fit }
        };
        Ok(Self { of_views: maps.into_iter().zip(fits(&samples)).map(guide).collect() })
    }

    /// The maps of a checkpoint with this metadata, of a run with `views` training views.
    ///
    /// # Errors
    /// [`Error::Checkpoint`] where they are not those of such a run.
    pub(super) fn from_metadata(metadata: &BTreeMap<String, String>, views: usize) -> Result<Self, Error> {
        if !metadata.contains_key(KEY) {
            return Ok(Self::default());
        }
        let found: Self = table(metadata, KEY)?;
        let in_order = found.of_views.windows(2).all(|pair| pair[0].view < pair[1].view);
        if !in_order || found.of_views.last().is_some_and(|last| last.view >= views) {
            return Err(Error::Checkpoint(format!("its `{KEY}` are not those of {views} views")));
        }
        if !found.of_views.iter().filter_map(|guide| guide.fit).all(|fit| fit.is_possible()) {
            return Err(Error::Checkpoint(format!("its `{KEY}` have an impossible scale or shift")));
        }
        Ok(found)
    }
}

/// A map's inverse depths where a backend computes.
struct Target<T> {
    image: T,
    /// 1/(mean inverse depth), world units; 0 where no pixel counts.
    unit: f32,
}

/// The depth maps of a run, and the targets made of them.
pub(super) struct DepthMaps<T> {
    guides: Guides,
    targets: Images<Target<T>>,
}

impl<T> DepthMaps<T> {
    /// `limit`: largest number of bytes of targets in memory.
    pub(super) fn new(guides: Guides, limit: u64) -> Self {
        Self { guides, targets: Images::new(limit) }
    }

    /// Numbers of maps; `None` without any.
    pub(super) fn counts(&self) -> Option<DepthMapCounts> {
        let maps = &self.guides.of_views;
        let used = maps.iter().filter(|guide| guide.fit.is_some()).count();
        (!maps.is_empty()).then_some(DepthMapCounts { maps: maps.len(), used })
    }

    /// The metadata for a checkpoint; `None` without depth maps.
    pub(super) fn to_metadata(&self) -> Result<Option<(&'static str, String)>, Error> {
        if self.guides.of_views.is_empty() {
            return Ok(None);
        }
        Ok(Some((KEY, to_table(KEY, &self.guides)?)))
    }

    /// Whether maps are to be fitted to renderings before the step after `step` of `iterations`
    /// steps.
    pub(super) fn is_due(&self, step: u32, iterations: u32) -> bool {
        let at = |share: f64| (share * f64::from(iterations)).round() as u32 == step;
        FITTED_AT.into_iter().any(at) && self.guides.of_views.iter().any(|guide| !guide.fixed)
    }

    /// Fits the maps that are neither fitted to points nor in world units to renderings of the
    /// scene; `render` draws it.
    ///
    /// # Errors
    /// Those of the backend, and of reading a depth map.
    pub(super) async fn fit_to_renderings<R: Optimizer<Scene3d, Target = T>>(
        &mut self,
        (on, splats): (&R, &R::Splats),
        views: &[PosedView],
        render: &RenderSettings,
    ) -> Result<(), Error> {
        let loose = || self.guides.of_views.iter().filter(|guide| !guide.fixed);
        let mut seen = Vec::new();
        for guide in loose() {
            let view = &views[guide.view];
            let camera = searched_camera(&view.camera);
            let image = on.draw(splats, &camera, &depths_and_gaps(render)).await?.0;
            seen.push(rendered_samples(&values_at(&depth_map(view)?, &camera), &image));
        }
        let fits = fits(&seen);
        let loose = self.guides.of_views.iter_mut().filter(|guide| !guide.fixed);
        loose.zip(fits).for_each(|(guide, fit)| guide.fit = fit);
        self.targets.forget();
        Ok(())
    }

    /// The gradients of the depth loss in a step with view `index` at 1/`factor` of its size, and
    /// their weight; `None` without a usable depth map. `render` draws the step's image.
    ///
    /// # Errors
    /// Those of the backend, and of reading an image or a depth map.
    pub(super) async fn gradients<R: Optimizer<Scene3d, Target = T>>(
        &mut self,
        (on, splats): (&R, &R::Splats),
        (view, index, factor): (&PosedView, usize, u32),
        render: &RenderSettings,
        (loss, progress): (&DepthLoss, f32),
    ) -> Result<Option<(R::Gradients, f32)>, Error> {
        let maps = &self.guides.of_views;
        let guide = maps.binary_search_by_key(&index, |guide| guide.view).ok().map(|place| maps[place]);
        let Some(fit) = guide.and_then(|guide| guide.fit) else { return Ok(None) };
        let factor = possible(&view.camera, COARSER * factor);
        let camera = reduced_camera(&view.camera, factor);
        let target = self.targets.get(index, factor, || target(on, view, &camera, factor, fit))?;
        let pass = on.forward(splats, &camera, &inverse_depths(render)).await?;
        let (_, gradients) = on.backward(splats, pass, &target.image, &Loss::L1).await?;
        Ok(Some((gradients, loss.at(progress) * target.unit)))
    }
}

/// Settings for rendering inverse depths, 0 where nothing is.
fn inverse_depths(render: &RenderSettings) -> RenderSettings {
    render.with(|s| {
        s.output = Output::InverseDepth;
        s.effects.background = Background::None;
        s.effects.statistics = Statistics::None;
    })
}

/// Settings for rendering inverse depths in the first channel, and these plus the transmittance in the second.
pub(super) fn depths_and_gaps(render: &RenderSettings) -> RenderSettings {
    inverse_depths(render).on([0.0, 1.0, 0.0])
}

/// The depth at a pixel of a rendering with [`depths_and_gaps`]; `None` where it is not clear.
pub(super) fn clear_depth([inverse, with_gaps, _]: [f32; 3]) -> Option<f32> {
    let opacity = 1.0 - (with_gaps - inverse);
    let depth = opacity / inverse;
    (opacity >= LEAST_OPACITY && depth > 0.0 && depth.is_finite()).then_some(depth)
}

/// The depth map of a view that had one when the run began.
fn depth_map(view: &PosedView) -> Result<gs_io::dataset::DepthMap, Error> {
    let gone = || gs_core::Error::State(format!("the depth map of view `{}` is no longer there", view.name));
    Ok(view.source.depth()?.ok_or_else(gone)?)
}

/// Values of a map and rendered depths ([`depths_and_gaps`]) at pixels [`CELL`] px apart.
fn rendered_samples(values: &[f32], rendered: &Image) -> Vec<Sample> {
    let (width, height) = rendered.size();
    let at = (CELL / 2..height).step_by(CELL as usize);
    let at = at.flat_map(|y| (CELL / 2..width).step_by(CELL as usize).map(move |x| (x, y)));
    at.filter_map(|(x, y)| {
        let (value, depth) = (values[(y * width + x) as usize], clear_depth(rendered.pixel(x, y))?);
        (value > 0.0).then_some(Sample { value, depth })
    })
    .collect()
}

/// Uploads the inverse depths of a view's map at 1/`factor` of its image's size, for `camera`; also
/// returns the number of bytes. Pixels do not count where the map's value is unknown, or where the
/// image is masked or rather transparent than opaque.
fn target<R: Optimizer<Scene3d>>(
    on: &R,
    view: &PosedView,
    camera: &Camera,
    factor: u32,
    fit: Fit,
) -> Result<(Target<R::Target>, u64), Error> {
    let values = values_at(&depth_map(view)?, camera);
    let posed = training_image(view, factor, None)?;
    let inverse = |index: usize| {
        let shown = posed.mask.as_ref().is_none_or(|mask| mask[index])
            && posed.alpha.as_ref().is_none_or(|alpha| alpha[index] >= 0.5);
        let depth = fit.known_depth(values[index]).filter(|depth| shown && *depth >= camera.near);
        depth.map_or(0.0, |depth| 1.0 / depth)
    };
    let inverse: Vec<f32> = (0..values.len()).map(inverse).collect();
    let mask: Vec<bool> = inverse.iter().map(|value| *value > 0.0).collect();
    let counted = mask.iter().filter(|&&counts| counts).count();
    let sum: f64 = inverse.iter().copied().map(f64::from).sum();
    let unit = if counted > 0 { (counted as f64 / sum) as f32 } else { 0.0 };
    let image = Image::from_pixels(camera.width, camera.height, inverse.into_iter().map(|v| [v; 3]).collect())?;
    let target = TargetImage { mask: Some(&mask), ..TargetImage::from(&image) };
    Ok((Target { image: on.upload_target(target)?, unit }, (4 * size_of::<f32>() * mask.len()) as u64))
}

#[cfg(test)]
mod tests;
