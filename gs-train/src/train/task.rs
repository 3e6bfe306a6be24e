//! Training from views: the part of the loop that knows cameras and photographs.

use std::fmt;

use glam::Vec3;
use gs_core::{
    Camera, Effects, Gaussian3d, Image, Loss, Rasterizer, RenderSettings, Scene3d, TrainStep, Wait,
    constants::HALF_DISPLAY_STEP,
    effects::{
        Background,
        called_for::{CallsForEffects, Narrow},
    },
    statistics::Culled,
};
use gs_density::{Residual, Rng};
use gs_io::dataset::PosedImage;
use rand::{RngExt, SeedableRng};

use super::{
    evaluation::{TrainingViews, measure},
    order::Order,
    pictures::{Picture, Pictures},
    resolution::{possible, reduced_camera},
    settings::{StepBackground, TrainSettings},
    view_dependence::{Residuals, Seen, ViewDependence},
    views::{PosedView, Views},
};
use crate::{
    clamped::Clamped,
    error::Error,
    joining::{AntialiasJoin, HarmonicsJoin, Joined, Joins},
    observer::Quality,
    statistics::mean,
    task::{RunSettings, StepContext, Trainable, TrainingTask},
};

/// Which of the generator's streams the backgrounds are drawn from.
const BACKDROP_STREAM: u64 = 0x6261_636b;

/// Without test views, so many of the training views, evenly spread, tell how good a scene is.
const STAND_INS: usize = 8;

/// By at most so many of the training views it is told how well a scene fits them: their mean is known to half a dB, and they cost less than
/// the test views.
const MOST_SAMPLED: usize = 32;

/// In so many views, residuals are asked how they depend on the view: as dear as twice so many steps without the optimiser.
const ASKED_VIEWS: u32 = 8;

/// Most Gaussians that are asked, evenly spread: enough for any share that matters.
const ASKED_GAUSSIANS: usize = 50_000;

/// In so many views, evenly spread, Gaussians narrower than a pixel are counted.
const COUNTED_VIEWS: usize = 4;

/// Views to train from, and their photographs as far as they have been read.
pub struct ViewsTask<R: Rasterizer<Scene3d>> {
    views: Views,
    extent: f32,
    order: Order,
    pictures: Pictures<R::Target>,
}

impl<R: Rasterizer<Scene3d>> fmt::Debug for ViewsTask<R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ViewsTask").field("views", &self.views).field("extent", &self.extent).finish_non_exhaustive()
    }
}

impl Trainable for Scene3d {
    type Settings = TrainSettings;
    type TrainingTask<R: Rasterizer<Self>> = ViewsTask<R>;

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

impl<R: Rasterizer<Scene3d>> ViewsTask<R> {
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
    pub(super) fn training_views(
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
            let frame = on.forward(splats, &view.camera, &render)?;
            let target = Self::target(on, &frame, &photograph, &render)?;
            psnr.extend(
                measure(&on.image(&frame)?, photograph, render.background_color()).map(|pair| pair.l1_and_psnr().1),
            );
            losses.push(f64::from(on.backward(splats, frame, &target, &settings.loss)?.0));
        }
        let measured = !psnr.is_empty();
        Ok(TrainingViews { views: psnr.len(), psnr: measured.then(|| mean(psnr)), loss: mean(losses) as f32 })
    }

    /// What a frame is compared with: the photograph before these settings' background, but where the mask says that it does not count, what
    /// is rendered, so that nothing pulls.
    fn target(
        on: &R,
        frame: &R::ForwardPass,
        photograph: &PosedImage,
        settings: &RenderSettings,
    ) -> Result<R::Target, Error> {
        let target = photograph.clone().over(settings.background_color());
        let target = match &photograph.mask {
            Some(mask) => where_masked(target, mask, &on.image(frame)?),
            None => target,
        };
        Ok(on.upload_target(&target)?)
    }

    /// The camera of a training view as the step after `step` steps sees it, and by what its sides are divided.
    fn reduced(&self, index: usize, settings: &TrainSettings, step: u32) -> (Camera, u32) {
        let camera = &self.views.train[index].camera;
        let factor = possible(camera, settings.resolution.factor(step as f32 / settings.iterations as f32));
        (if factor > 1 { reduced_camera(camera, factor) } else { *camera }, factor)
    }

    /// The largest share of Gaussians narrower than a pixel, over some of the views.
    fn narrowest(&self, scene: &Scene3d, settings: &TrainSettings, step: u32) -> Narrow {
        let count = self.views.train.len();
        let asked = count.min(COUNTED_VIEWS);
        let views = (0..asked).map(|k| self.reduced(k * count / asked, settings, step).0);
        let found = views.map(|camera| scene.narrow(&camera, &settings.render));
        found.max_by(|a, b| a.share().total_cmp(&b.share())).unwrap_or_default()
    }

    /// How residuals depend on the view, by harmonics of this degree, in the views of the next few steps.
    fn view_dependence(
        &mut self,
        on: &R,
        splats: &R::Splats,
        settings: &TrainSettings,
        (step, degree): (u32, u8),
        render: &RenderSettings,
        means: &[Vec3],
    ) -> Result<ViewDependence, Error> {
        let count = self.views.train.len();
        let mut asked: Vec<usize> =
            (step..step.saturating_add(ASKED_VIEWS)).map(|at| self.order.view(settings.seed, at, count)).collect();
        asked.sort_unstable();
        asked.dedup();
        let stride = means.len().div_ceil(ASKED_GAUSSIANS).max(1);
        let mut residuals = Residuals::of(means.len().div_ceil(stride));
        let fixed = (settings.background == StepBackground::Same).then(|| render.background_color());
        for index in asked {
            let (camera, factor) = self.reduced(index, settings, step);
            let frame = on.forward(splats, &camera, render)?;
            // Compared with what is darker by 1 everywhere, each Gaussian's gradient is what it shows.
            let mut darker = on.image(&frame)?;
            darker.pixels_mut().iter_mut().for_each(|pixel| *pixel = pixel.map(|value| value - 1.0));
            let (_, gradients) = match self.pictures.get(on, &self.views.train[index], index, factor, fixed)? {
                Picture::Target(target) => on.backward(splats, frame, target, &Loss::L2)?,
                Picture::PosedImage(photograph) => {
                    let target = Self::target(on, &frame, photograph, render)?;
                    on.backward(splats, frame, &target, &Loss::L2)?
                }
            };
            let pulls = on.download_gradients(splats, &gradients)?;
            let again = on.forward(splats, &camera, render)?;
            let (_, gradients) = on.backward(splats, again, &on.upload_target(&darker)?, &Loss::L2)?;
            let shown = on.download_gradients(splats, &gradients)?;
            let (position, of_one) = (camera.position(), pulls.sh_len());
            let seen = (0..means.len()).step_by(stride).map(|index| Seen {
                direction: (means[index] - position).normalize_or_zero(),
                pull: pulls.sh[index * of_one],
                shown: shown.sh[index * of_one].max_element(),
            });
            residuals.add(seen);
        }
        Ok(residuals.explained_by(degree))
    }

    /// A step whose loss leaves out what the mask does.
    fn masked_step(
        on: &R,
        splats: &mut R::Splats,
        camera: &Camera,
        photograph: &PosedImage,
        step: &TrainStep<'_>,
    ) -> Result<(), Error> {
        let frame = on.forward(splats, camera, step.settings)?;
        let target = Self::target(on, &frame, photograph, step.settings)?;
        let (loss, gradients) = on.backward(splats, frame, &target, &step.loss)?;
        on.step(splats, &gradients, step.rates)?;
        // Losses are told in the order of their steps, and some may still be under way.
        let mut known = Vec::new();
        on.losses(splats, Wait::All, &mut known)?;
        known.push(loss);
        *on.unread_losses(splats) = known;
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

impl<R: Rasterizer<Scene3d>> TrainingTask<R, Scene3d> for ViewsTask<R> {
    fn extent(&self) -> f32 {
        self.extent
    }

    fn pictures(&self) -> u32 {
        self.views.train.len() as u32
    }

    fn send(
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
        match self.pictures.get(on, view, index, factor, fixed)? {
            Picture::Target(target) => on.train_step(splats, &camera, target, &step)?,
            Picture::PosedImage(photograph) if photograph.mask.is_some() => {
                Self::masked_step(on, splats, &camera, photograph, &step)?;
            }
            Picture::PosedImage(photograph) => {
                let target = photograph.clone().over(render.background_color());
                on.train_step(splats, &camera, &on.upload_target(&target)?, &step)?;
            }
        }
        Ok(())
    }

    fn residual(&mut self, _: &R, _: &R::Splats, _: &TrainSettings, _: &Effects) -> Result<Option<&Residual>, Error> {
        Ok(None)
    }

    fn after_edit(&mut self, _: &R, _: &mut R::Splats, _: &TrainSettings, _: &Effects) -> Result<(), Error> {
        Ok(())
    }

    /// Antialiasing by the widths of Gaussians, harmonics by how residuals depend on the view. Before the first step there are no residuals worth
    /// asking: then those degrees join that the first scene has.
    fn called_for(
        &mut self,
        on: &R,
        splats: &R::Splats,
        settings: &TrainSettings,
        step: u32,
        joins: &Joins,
    ) -> Result<Joined, Error> {
        let wanted = &settings.render;
        let asks_for_antialias = settings.joining.asks_for_antialias(step, &wanted.effects, joins);
        let asks_for_sh = settings.asks_for_sh(step, joins);
        let mut joined = Joined::default();
        if asks_for_antialias.is_none() && asks_for_sh.is_none() {
            return Ok(joined);
        }
        let scene = on.download(splats)?;
        if let Some(calls) = asks_for_antialias {
            let narrow = self.narrowest(&scene, settings, step);
            joined.antialias =
                (narrow.share() > calls.narrow).then(|| AntialiasJoin::new(wanted.effects.antialias, narrow));
        }
        if let Some((calls, next)) = asks_for_sh {
            joined.harmonics = if step == 0 {
                let degree = Effects::called_for(&scene, &[], wanted)?.settings.effects.sh_degree;
                (degree > 0).then_some(HarmonicsJoin { degree, explains: None })
            } else {
                let effects = settings.effects_after(step, joins);
                let mut render = background(settings, step);
                render.effects = Effects { background: render.effects.background, ..effects };
                let found = self.view_dependence(on, splats, settings, (step, next), &render, &scene.means)?;
                let called = found.share > calls.view_dependence && found.amplitude > HALF_DISPLAY_STEP;
                called.then_some(HarmonicsJoin { degree: next, explains: Some(found.share) })
            };
        }
        Ok(joined)
    }

    /// Means over the test views (or those that stand in for them) of which some pixel counts, and what was left out in all of them
    /// together.
    fn quality(
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
            let (rendered, left_out) = on.draw(splats, &view.camera, &render)?;
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
