//! Training from views: the part of the loop that knows cameras and photographs.

use std::fmt;

use gs_core::{
    Camera, Effects, Gaussian3d, Image, Optimizer, RenderSettings, Scene3d, TrainStep, effects::Background,
    metrics::mean, statistics::Culled,
};
use gs_density::{Residual, Rng};
use rand::{RngExt, SeedableRng};

use super::{
    evaluation::{TrainingViews, measure},
    order::Order,
    pictures::{self, Pictures},
    resolution::{possible, reduced_camera},
    settings::{StepBackground, TrainSettings},
    views::{PosedView, Views},
};
use crate::{
    clamped::Clamped,
    error::Error,
    observer::Quality,
    task::{StepContext, Trainable, TrainingTask},
};

/// Which of the generator's streams the backgrounds are drawn from.
const BACKDROP_STREAM: u64 = 0x6261_636b;

/// Without test views, so many of the training views, evenly spread, tell how good a scene is.
const STAND_INS: usize = 8;

/// By at most so many of the training views it is told how well a scene fits them: their mean is known to half a dB, and they cost less than
/// the test views.
const MOST_SAMPLED: usize = 32;

/// Views to train from, and their photographs as far as they have been read.
pub struct ViewsTask<R: Optimizer<Scene3d>> {
    views: Views,
    extent: f32,
    order: Order,
    pictures: Pictures<R::Target>,
}

impl<R: Optimizer<Scene3d>> fmt::Debug for ViewsTask<R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ViewsTask").field("views", &self.views).field("extent", &self.extent).finish_non_exhaustive()
    }
}

impl Trainable for Scene3d {
    type Settings = TrainSettings;
    type TrainingTask<R: Optimizer<Self>> = ViewsTask<R>;

    fn parameters(g: &Gaussian3d) -> Vec<(&'static str, Vec<f32>)> {
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

impl<R: Optimizer<Scene3d>> ViewsTask<R> {
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

    /// Some of the views that it is trained with, evenly spread: as many as there are to judge it by, and [`MOST_SAMPLED`] at most.
    fn sample(&self) -> impl Iterator<Item = &PosedView> {
        let (train, test) = (&self.views.train, &self.views.test);
        let wanted = if test.is_empty() { STAND_INS } else { test.len().min(MOST_SAMPLED) };
        let count = train.len().min(wanted);
        (0..count).map(move |number| &train[number * train.len() / count])
    }

    /// How well the scene fits the views that it is trained with, by a sample of them.
    pub(super) async fn training_views(
        &self,
        on: &R,
        splats: &R::Splats,
        settings: &TrainSettings,
        effects: &Effects,
    ) -> Result<TrainingViews, Error> {
        let render = shown(settings, effects);
        let (mut psnr, mut losses) = (Vec::new(), Vec::new());
        for view in self.sample() {
            let photograph = view.photograph()?;
            let frame = on.forward(splats, &view.camera, &render).await?;
            let background = render.background_color();
            let (target, _) = pictures::target(on, photograph.clone(), Some(background))?;
            psnr.extend(measure(&on.image(&frame).await?, photograph, background).map(|pair| pair.l1_and_psnr().1));
            losses.push(f64::from(on.backward(splats, frame, &target, &settings.loss).await?.0));
        }
        let measured = !psnr.is_empty();
        Ok(TrainingViews { views: psnr.len(), psnr: measured.then(|| mean(psnr)), loss: mean(losses) as f32 })
    }

    /// The camera of a training view as the step after `step` steps sees it, and by what its sides are divided.
    fn reduced(&self, index: usize, settings: &TrainSettings, step: u32) -> (Camera, u32) {
        let camera = &self.views.train[index].camera;
        let factor = possible(camera, settings.resolution.factor(step as f32 / settings.iterations as f32));
        (if factor > 1 { reduced_camera(camera, factor) } else { *camera }, factor)
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
fn background(settings: &TrainSettings, step: u32) -> RenderSettings {
    match settings.background {
        StepBackground::Same => settings.render,
        StepBackground::Random => {
            let state = (u64::from(settings.seed) << 32 | u64::from(step)) ^ BACKDROP_STREAM.rotate_left(16);
            let mut rng = Rng::seed_from_u64(state);
            settings.render.on(std::array::from_fn(|_| rng.random_range(0.0f32..1.0)))
        }
    }
}

impl<R: Optimizer<Scene3d>> TrainingTask<R, Scene3d> for ViewsTask<R> {
    fn extent(&self) -> f32 {
        self.extent
    }

    fn pictures(&self) -> u32 {
        self.views.train.len() as u32
    }

    async fn send(
        &mut self,
        on: &R,
        splats: &mut R::Splats,
        settings: &TrainSettings,
        context: StepContext,
    ) -> Result<(), Error> {
        let StepContext { step, effects, lr_scale, binning } = context;
        let index = self.order.view(settings.seed, step, self.views.train.len());
        let (camera, factor) = self.reduced(index, settings, step);
        let view = &self.views.train[index];
        let mut render = background(settings, step);
        let background = render.effects.background;
        render.effects = Effects { background, ..effects };
        let rates = settings.rates_at(step, self.extent).times(lr_scale);
        let step = TrainStep { settings: &render, loss: settings.loss, rates: &rates, binning };

        let fixed = (settings.background == StepBackground::Same).then(|| render.background_color());
        let target = self.pictures.get(on, view, index, factor, fixed)?;
        Ok(on.train_step(splats, &camera, target, &step).await?)
    }

    async fn residual(
        &mut self,
        _: &R,
        _: &R::Splats,
        _: &TrainSettings,
        _: &Effects,
    ) -> Result<Option<&Residual>, Error> {
        Ok(None)
    }

    async fn after_edit(&mut self, _: &R, _: &mut R::Splats, _: &TrainSettings, _: &Effects) -> Result<(), Error> {
        Ok(())
    }

    /// Means over the test views (or those that stand in for them) of which some pixel counts, and what was left out in all of them
    /// together.
    async fn quality(
        &self,
        on: &R,
        splats: &R::Splats,
        settings: &TrainSettings,
        effects: &Effects,
    ) -> Result<Quality, Error> {
        let render = shown(settings, effects);
        let judges = self.judges();
        let (mut l1, mut psnr, mut culled) = (Vec::new(), Vec::new(), Culled::default());
        for view in &judges {
            let (rendered, left_out) = on.draw(splats, &view.camera, &render).await?;
            culled = culled.plus(left_out);
            if let Some(pair) = measure(&rendered, view.photograph()?, render.background_color()) {
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

/// How a scene is shown that has been trained with these effects: before the background of the settings.
pub(crate) fn shown(settings: &TrainSettings, effects: &Effects) -> RenderSettings {
    let mut render = RenderSettings { effects: *effects, ..settings.render };
    if settings.background == StepBackground::Random {
        render.effects.background = Background::Solid;
    }
    render
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn random_backgrounds_differ_from_step_to_step_and_repeat_with_the_seed() {
        let settings = TrainSettings { background: StepBackground::Random, ..TrainSettings::default() };
        let colors: Vec<[f32; 3]> = (0..20).map(|step| background(&settings, step).background_color()).collect();
        assert!(colors.windows(2).all(|pair| pair[0] != pair[1]));
        assert!(colors.iter().flatten().all(|v| (0.0..1.0).contains(v)));
        assert_eq!(colors[7], background(&settings, 7).background_color());
        let same = TrainSettings { background: StepBackground::Same, ..settings };
        assert_eq!(background(&same, 3), same.render);
    }

    #[test]
    fn masked_pixels_are_as_rendered() {
        let target = Image::filled(2, 1, [1.0; 3]).unwrap();
        let rendered = Image::filled(2, 1, [0.25; 3]).unwrap();
        let masked = where_masked(target, &[true, false], &rendered);
        assert_eq!(masked.pixels(), [[1.0; 3], [0.25; 3]]);
    }
}
