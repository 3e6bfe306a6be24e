//! Training from views: the part of the loop that knows cameras and photographs.

use std::fmt;

use gs_core::{
    Camera, Image, Rasterizer, RenderSettings, SpatialGaussian, SpatialScene, TrainStep, Wait,
    effects::{Background, Statistics},
    statistics::Culled,
};
use gs_density::{Residual, Rng};
use rand::{RngExt, SeedableRng};

use super::{
    evaluation::measure,
    order::Order,
    pictures::{Picture, Pictures},
    resolution::{possible, reduced_camera},
    settings::{Backdrop, SpatialSettings},
    views::{PosedView, Views},
};
use crate::{
    clamped::Clamped,
    course::{Course, Due, Trainable},
    error::Error,
    observer::Quality,
    statistics::mean,
};

/// Which of the generator's streams the backgrounds are drawn from.
const BACKDROP_STREAM: u64 = 0x6261_636b;

/// Without test views, so many of the training views, evenly spread, tell how good a scene is.
const STAND_INS: usize = 8;

/// Views to train from, and their photographs as far as they have been read.
pub struct ViewsCourse<R: Rasterizer<SpatialScene>> {
    views: Views,
    extent: f32,
    order: Order,
    pictures: Pictures<R::Target>,
}

impl<R: Rasterizer<SpatialScene>> fmt::Debug for ViewsCourse<R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ViewsCourse").field("views", &self.views).field("extent", &self.extent).finish_non_exhaustive()
    }
}

impl Trainable for SpatialScene {
    type Settings = SpatialSettings;
    type Course<R: Rasterizer<Self>> = ViewsCourse<R>;

    fn parameters(g: &SpatialGaussian) -> Vec<(&'static str, Vec<f32>)> {
        vec![
            ("mean (world units)", g.mean.to_array().to_vec()),
            ("ln-scale", g.log_scale.to_array().to_vec()),
            ("rotation", g.rotation.to_vec()),
            ("harmonics", g.sh.iter().flat_map(|c| c.to_array()).collect()),
        ]
    }

    fn log_scale_range(&self, index: usize) -> (f32, f32) {
        (self.log_scales[index].min_element(), self.log_scales[index].max_element())
    }
}

impl<R: Rasterizer<SpatialScene>> ViewsCourse<R> {
    pub(super) fn new(views: Views, extent: f32) -> Self {
        let pictures = Pictures::new(views.keep_bytes);
        Self { views, extent, order: Order::default(), pictures }
    }

    /// The views.
    pub fn views(&self) -> &Views {
        &self.views
    }

    /// Those by which the scene is judged: the test views, or else a few of the training views.
    pub(super) fn judges(&self) -> Vec<&PosedView> {
        if !self.views.test.is_empty() {
            return self.views.test.iter().collect();
        }
        let train = &self.views.train;
        train.iter().step_by(train.len().div_ceil(STAND_INS)).collect()
    }

    /// A step whose loss leaves out what the mask does: there the target is what is rendered, so that nothing pulls.
    fn masked_step(
        on: &R,
        cloud: &mut R::Cloud,
        camera: &Camera,
        (target, mask): (Image, &[bool]),
        step: &TrainStep<'_>,
    ) -> Result<(), Error> {
        let frame = on.forward(cloud, camera, step.settings)?;
        let target = on.upload_target(&where_masked(target, mask, &on.image(&frame)?))?;
        let (loss, gradients) = on.backward(cloud, frame, &target, &step.loss)?;
        on.step(cloud, &gradients, step.rates)?;
        // Losses are told in the order of their steps, and some may still be under way.
        let mut known = Vec::new();
        on.losses(cloud, Wait::All, &mut known)?;
        known.push(loss);
        *on.unread_losses(cloud) = known;
        Ok(())
    }
}

/// The target, but the rendered pixels where the mask says that it does not count.
pub(super) fn where_masked(mut target: Image, mask: &[bool], rendered: &Image) -> Image {
    for ((pixel, &counts), &rendered) in target.pixels_mut().iter_mut().zip(mask).zip(rendered.pixels()) {
        if !counts {
            *pixel = rendered;
        }
    }
    target
}

/// What is behind in the step that follows `step` steps.
fn backdrop(settings: &SpatialSettings, step: u32) -> RenderSettings {
    match settings.backdrop {
        Backdrop::Same => settings.render,
        Backdrop::Random => {
            let state = (u64::from(settings.seed) << 32 | u64::from(step)) ^ BACKDROP_STREAM.rotate_left(16);
            let mut rng = Rng::seed_from_u64(state);
            settings.render.on(std::array::from_fn(|_| rng.random_range(0.0f32..1.0)))
        }
    }
}

impl<R: Rasterizer<SpatialScene>> Course<R, SpatialScene> for ViewsCourse<R> {
    fn extent(&self) -> f32 {
        self.extent
    }

    fn send(&mut self, on: &R, cloud: &mut R::Cloud, settings: &SpatialSettings, due: Due) -> Result<(), Error> {
        let Due { step, statistics, binning } = due;
        let index = self.order.view(settings.seed, step, self.views.train.len());
        let view = &self.views.train[index];
        let factor = possible(&view.camera, settings.resolution.factor(step as f32 / settings.iterations as f32));
        let camera = if factor > 1 { reduced_camera(&view.camera, factor) } else { view.camera };
        let mut render = backdrop(settings, step);
        render.effects.statistics = statistics;
        render.effects.sh_degree = settings.sh_degree_at(step);
        let rates = settings.rates_at(step, self.extent);
        let step = TrainStep { settings: &render, loss: settings.loss, rates: &rates, binning };

        let fixed = (settings.backdrop == Backdrop::Same).then(|| render.backdrop());
        match self.pictures.get(on, view, index, factor, fixed)? {
            Picture::Target(target) => on.train_step(cloud, &camera, target, &step)?,
            Picture::Photograph(photograph) => {
                let target = photograph.clone().over(render.backdrop());
                match &photograph.mask {
                    Some(mask) => Self::masked_step(on, cloud, &camera, (target, mask), &step)?,
                    None => on.train_step(cloud, &camera, &on.upload_target(&target)?, &step)?,
                }
            }
        }
        Ok(())
    }

    fn residual(&mut self, _: &R, _: &R::Cloud, _: &SpatialSettings) -> Result<Option<&Residual>, Error> {
        Ok(None)
    }

    fn after_edit(&mut self, _: &R, _: &mut R::Cloud, _: &SpatialSettings) -> Result<(), Error> {
        Ok(())
    }

    /// Means over the test views (or those that stand in for them) of which some pixel counts, and what was left out in all of them
    /// together.
    fn quality(&self, on: &R, cloud: &R::Cloud, settings: &SpatialSettings, step: u32) -> Result<Quality, Error> {
        let render = shown(settings, step);
        let judges = self.judges();
        let (mut l1, mut psnr, mut culled) = (Vec::new(), Vec::new(), Culled::default());
        for view in &judges {
            let frame = on.forward(cloud, &view.camera, &render)?;
            culled = culled.plus(on.culled(&frame)?);
            if let Some(pair) = measure(&on.image(&frame)?, view.photograph()?, render.backdrop()) {
                let measured = pair.l1_and_psnr();
                l1.push(measured.0);
                psnr.push(measured.1);
            }
        }
        if l1.is_empty() {
            return Err(Error::NothingCounts { views: judges.len() });
        }
        Ok(Quality { l1: mean(l1), psnr: mean(psnr), culled, clamped: Clamped::default() })
    }
}

/// How the scene is shown after `step` steps: with the harmonics that have been trained, before the background of the settings.
pub(super) fn shown(settings: &SpatialSettings, step: u32) -> RenderSettings {
    let mut render = settings.render;
    render.effects.statistics = Statistics::None;
    render.effects.sh_degree = settings.sh_degree_at(step.saturating_sub(1));
    if settings.backdrop == Backdrop::Random {
        render.effects.background = Background::Solid;
    }
    render
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn random_backdrops_differ_from_step_to_step_and_repeat_with_the_seed() {
        let settings = SpatialSettings { backdrop: Backdrop::Random, ..SpatialSettings::default() };
        let colors: Vec<[f32; 3]> = (0..20).map(|step| backdrop(&settings, step).backdrop()).collect();
        assert!(colors.windows(2).all(|pair| pair[0] != pair[1]));
        assert!(colors.iter().flatten().all(|v| (0.0..1.0).contains(v)));
        assert_eq!(colors[7], backdrop(&settings, 7).backdrop());
        let same = SpatialSettings { backdrop: Backdrop::Same, ..settings };
        assert_eq!(backdrop(&same, 3), same.render);
    }

    #[test]
    fn masked_pixels_are_as_rendered() {
        let target = Image::filled(2, 1, [1.0; 3]).unwrap();
        let rendered = Image::filled(2, 1, [0.25; 3]).unwrap();
        let masked = where_masked(target, &[true, false], &rendered);
        assert_eq!(masked.pixels(), [[1.0; 3], [0.25; 3]]);
    }
}
