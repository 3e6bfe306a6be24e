//! The task of training from views.

use std::{collections::BTreeMap, fmt, sync::OnceLock};

use bytemuck::cast_slice_mut;
use gs_core::{
    Camera, Culled, Effects, Gaussian3d, Optimizer, RenderSettings, Scene3d, TrainStep, effects::Statistics,
    metrics::mean,
};
use gs_density::{Evidence, EvidenceRequest};
use rayon::prelude::*;

use super::{
    evaluation::{TrainingViews, measure, together},
    evidence::{Gathering, views_of_round},
    exposure::{ExposureReport, Exposures},
    poses::{Poses, PosesReport},
    settings::TrainSettings,
    trial::report::Trial,
    unseen::unseen,
};
use crate::views::{Images, Order, PosedView, STAND_INS, Views, images, possible, reduced_camera};
use crate::{
    error::Error,
    memory::{self, READ_AHEAD},
    run::{At, Clamped, Quality, StepContext, Trainable, TrainingTask},
};

/// Steps whose images are read ahead.
pub(super) const AHEAD: u32 = READ_AHEAD as u32;

/// Largest sample of training views for their quality: their mean is known to half a dB, and they
/// cost less than the test views.
const MOST_SAMPLED: usize = 32;

/// Views to train from, and their images as far as they have been read.
pub struct ViewsTask<R: Optimizer<Scene3d>> {
    views: Views,
    extent: f32,
    order: Order,
    /// The order of the steps whose images are read ahead, and the first step that has not been.
    ahead: (Order, u32),
    images: Images<R::Target>,
    /// Whether the images' targets take as little memory as possible.
    compact: bool,
    pub(super) exposures: Exposures,
    poses: Poses,
    /// What a trial before the run found.
    pub(super) trial: Option<Trial>,
    /// Checksums of the views' images, those that are known.
    digests: Vec<OnceLock<u32>>,
}

/// The entry of a checkpoint's metadata with the checksums of the views' images.
const DIGESTS_ENTRY: &str = "image-digests";

/// In place of the checksum of an image that could not be read: it had no part in the run.
const UNKNOWN: &str = "-";

/// Fails if the images of the views are others than those of a checkpoint with this metadata.
pub(super) fn check_images(metadata: &BTreeMap<String, String>, views: &Views, digests: &[u32]) -> Result<(), Error> {
    let stored = metadata.get(DIGESTS_ENTRY);
    let stored = stored.ok_or_else(|| Error::Checkpoint(format!("its metadata lack `{DIGESTS_ENTRY}`")))?;
    let mut stored = stored.split(' ');
    let all = views.train.iter().chain(&views.test).zip(digests);
    let changed: Vec<&str> =
        all.filter(|(_, digest)| !is_same(stored.next(), **digest)).map(|(view, _)| &*view.name).collect();
    match changed.first() {
        None => Ok(()),
        Some(first) => Err(Error::OtherImages { count: changed.len(), first: (*first).to_owned() }),
    }
}

fn is_same(stored: Option<&str>, digest: u32) -> bool {
    stored.is_some_and(|stored| stored == UNKNOWN || stored == text_of(digest))
}

fn text_of(digest: u32) -> String {
    format!("{digest:08x}")
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
            ("SH", g.sh.iter().flat_map(|c| c.to_array()).collect()),
        ]
    }

    fn log_scale_range(&self, index: usize) -> (f32, f32) {
        (self.log_scales[index].min_element(), self.log_scales[index].max_element())
    }

    fn numbers_mut(&mut self) -> Vec<&mut [f32]> {
        let Self { means, log_scales, rotations, opacity_logits, sh, sh_degree: _ } = self;
        let [means, log_scales, sh] = [means, log_scales, sh].map(|vectors| cast_slice_mut(vectors));
        vec![means, log_scales, rotations.as_flattened_mut(), opacity_logits, sh]
    }
}

/// The divisor of the images' sides in the step after `step` steps.
fn factor(settings: &TrainSettings, step: u32) -> u32 {
    settings.resolution.factor(step as f32 / settings.iterations as f32)
}

impl<R: Optimizer<Scene3d>> ViewsTask<R> {
    /// `digests` are the checksums of the images, where they are known.
    pub(super) fn new(views: Views, digests: &[u32], extent: f32, solved: (Exposures, Poses)) -> Self {
        let (exposures, poses) = solved;
        let pixels = views.train_cameras().map(|camera| u64::from(camera.width) * u64::from(camera.height)).sum();
        let images = Images::new(views.keep_bytes.saturating_sub(views.cached_bytes()));
        let of_view = |index| digests.get(index).map_or_else(OnceLock::new, |&digest| OnceLock::from(digest));
        let digests = (0..views.train.len() + views.test.len()).map(of_view).collect();
        let compact = memory::is_compact(pixels);
        let (order, ahead) = (Order::default(), (Order::default(), 0));
        Self { views, extent, order, ahead, images, compact, exposures, poses, trial: None, digests }
    }

    /// The views.
    pub(crate) fn views(&self) -> &Views {
        &self.views
    }

    /// What was found about the exposure of the training views, if it has been solved.
    pub(super) fn exposure_report(&self) -> Option<ExposureReport> {
        self.exposures.report()
    }

    /// What was found about the poses of the training views; `None` where they are not refined.
    pub(super) fn poses_report(&self) -> Option<PosesReport> {
        self.poses.report()
    }

    /// The test views, or else a few of the training views.
    pub(super) fn evaluation_views(&self) -> Vec<&PosedView> {
        if !self.views.test.is_empty() {
            return self.views.test.iter().collect();
        }
        let train = &self.views.train;
        train.iter().step_by(train.len().div_ceil(STAND_INS)).collect()
    }

    /// The views that are measured while the scene is trained: [`Self::evaluation_views`], or
    /// [`Views::most_measured`] of them, evenly spread.
    pub(super) fn measured_views(&self) -> Vec<&PosedView> {
        let views = self.evaluation_views();
        let count = views.len().min(self.views.most_measured.max(1));
        (0..count).map(|number| views[number * views.len() / count]).collect()
    }

    /// Lets the images of the next steps be read.
    fn read_ahead(&mut self, settings: &TrainSettings, step: u32) {
        let (order, next) = &mut self.ahead;
        for step in (*next).max(step)..(step + AHEAD).min(settings.iterations) {
            let index = order.view(settings.seed, step, self.views.train.len());
            if !self.images.has(index) {
                self.views.train[index].source.read_ahead();
            }
        }
        *next = step + AHEAD;
    }

    /// The checksum of a view's image in a checkpoint.
    fn digest(&self, index: usize, view: &PosedView) -> String {
        let digest = self.digests[index].get().copied().or_else(|| view.source.digest().ok());
        digest.map_or_else(|| UNKNOWN.to_owned(), |digest| text_of(*self.digests[index].get_or_init(|| digest)))
    }

    /// A sample of the training views, evenly spread: as many as there are test views, at most
    /// [`MOST_SAMPLED`].
    fn sample(&self) -> impl Iterator<Item = usize> {
        let (train, test) = (&self.views.train, &self.views.test);
        let wanted = if test.is_empty() { STAND_INS } else { test.len().min(MOST_SAMPLED) };
        let count = train.len().min(wanted);
        (0..count).map(move |number| number * train.len() / count)
    }

    /// Quality on a sample of the training views.
    pub(super) async fn training_views(
        &self,
        At { on, splats, settings, effects }: At<'_, R, Scene3d>,
    ) -> Result<TrainingViews, Error> {
        let render = shown(settings, &effects);
        let (mut psnr, mut losses) = (Vec::new(), Vec::new());
        let sample: Vec<usize> = self.sample().collect();
        let together = together(sample.iter().map(|&index| &self.views.train[index]));
        for (number, batch) in sample.chunks(together).enumerate() {
            let ahead = sample[number * together..].iter().take(2 * together);
            ahead.for_each(|&next| self.views.train[next].source.read_ahead());
            let (train, exposures) = (&self.views.train, &self.exposures);
            let image = |&index: &usize| images::training_image(&train[index], 1, exposures.map(index));
            for (&index, posed) in batch.iter().zip(batch.par_iter().map(image).collect::<Vec<_>>()) {
                let posed = posed?;
                let pass = on.forward(splats, &self.views.train[index].camera, &render).await?;
                let background = render.background_color();
                let (target, _) = images::target(on, posed.clone(), background, true)?;
                if let Some(pair) = measure(&on.image(&pass).await?, posed, background)? {
                    psnr.push(pair.l1_and_psnr()?.1);
                }
                losses.push(f64::from(on.loss(splats, pass, &target, &settings.loss).await?));
            }
        }
        let measured = !psnr.is_empty();
        Ok(TrainingViews { views: psnr.len(), psnr: measured.then(|| mean(psnr)), loss: mean(losses) as f32 })
    }

    /// The camera of a training view at the resolution of the step after `step` steps, and the
    /// divisor of its sides.
    fn reduced(&self, index: usize, settings: &TrainSettings, step: u32) -> (Camera, u32) {
        let camera = &self.views.train[index].camera;
        let factor = possible(camera, factor(settings, step));
        (if factor > 1 { reduced_camera(camera, factor) } else { *camera }, factor)
    }
}

impl<R: Optimizer<Scene3d>> TrainingTask<R, Scene3d> for ViewsTask<R> {
    const HAS_VIEWS: bool = true;

    fn extent(&self) -> f32 {
        self.extent
    }

    fn images(&self) -> u32 {
        self.views.train.len() as u32
    }

    async fn prepare(
        &mut self,
        At { on, splats, settings, effects }: At<'_, R, Scene3d>,
        step: u32,
    ) -> Result<(), Error> {
        let views = self.views.train.len() as u32;
        if self.exposures.is_due(settings.exposure, views, step, settings.iterations) {
            let render = shown(settings, &Effects { statistics: Statistics::None, ..effects });
            let were_used = self.exposures.are_used();
            let factor = factor(settings, step);
            self.exposures.solve((on, splats), &self.views.train, &render, (settings.exposure, factor)).await?;
            if were_used || self.exposures.are_used() {
                self.images.forget();
            }
        }
        Ok(())
    }

    fn state(&self) -> Result<Vec<(&'static str, String)>, Error> {
        let frame = self.views.frame;
        let frame = (!frame.is_world()).then(|| (gs_io::FRAME_ENTRY, frame.to_toml()));
        let views = self.views.train.iter().chain(&self.views.test).enumerate();
        let digests = views.map(|(index, view)| self.digest(index, view)).collect::<Vec<_>>().join(" ");
        let trial = self.trial.as_ref().map(Trial::to_metadata).transpose()?;
        let own =
            [self.exposures.to_metadata()?, self.poses.to_metadata()?, trial, frame, Some((DIGESTS_ENTRY, digests))];
        Ok(own.into_iter().flatten().collect())
    }

    async fn send(
        &mut self,
        on: &R,
        splats: &mut R::Splats,
        settings: &TrainSettings,
        context: StepContext,
    ) -> Result<(), Error> {
        let StepContext { step, effects, full_depth, lr_scale, binning } = context;
        self.read_ahead(settings, step);
        let views = self.views.train.len() as u32;
        // A step that only measures the loss moves nothing.
        let learns = lr_scale > 0.0;
        if learns && step.is_multiple_of(views) {
            let now = (step, settings.iterations);
            self.poses.move_cameras((on, splats), &mut self.views.train, self.extent, now).await?;
        }
        let index = self.order.view(settings.seed, step, self.views.train.len());
        let (camera, factor) = self.reduced(index, settings, step);
        let view = &self.views.train[index];
        let mut render = settings.render;
        let background = render.effects.background;
        render.effects = Effects { background, ..effects };
        render.full_depth = full_depth;
        render.dropout = settings.dropout_at(step);
        render.camera_gradient = learns && self.poses.needs_gradient(step, settings.iterations);
        let rates = settings.rates_at(step, self.extent).times(lr_scale);
        let step = TrainStep { settings: &render, loss: settings.loss, rates: &rates, binning };

        let background = render.background_color();
        let (map, compact) = (self.exposures.map(index), self.compact);
        let target = self.images.get(index, factor, || {
            images::target(on, images::training_image(view, factor, map)?, background, compact)
        })?;
        on.train_step(splats, &camera, target, &step).await?;
        if render.camera_gradient {
            self.poses.sent(index);
        }
        Ok(())
    }

    async fn settle(&mut self, on: &R, splats: &mut R::Splats) -> Result<(), Error> {
        self.poses.collect(on, splats).await
    }

    async fn evidence(
        &mut self,
        At { on, splats, settings, effects }: At<'_, R, Scene3d>,
        scene: &Scene3d,
        step: u32,
        request: EvidenceRequest,
    ) -> Result<Option<Evidence>, Error> {
        let mut gathering = Gathering::new(on, (scene, splats), shown(settings, &effects), request)?;
        let drawn = views_of_round(settings.seed, step, self.views.train.len(), &request);
        for (number, &index) in drawn.iter().enumerate() {
            drawn.iter().skip(number).take(AHEAD as usize).for_each(|&next| self.views.train[next].source.read_ahead());
            let (camera, factor) = self.reduced(index, settings, step);
            let posed = images::training_image(&self.views.train[index], factor, self.exposures.map(index))?;
            gathering.add(&camera, posed, &settings.loss).await?;
        }
        Ok(Some(gathering.finish()))
    }

    fn unwanted(&self, scene: &Scene3d, settings: &TrainSettings, effects: &Effects) -> Vec<u32> {
        match settings.remove_unseen && !settings.exactly {
            true => unseen(scene, self.views.train_cameras(), &shown(settings, effects)),
            false => Vec::new(),
        }
    }

    /// Means over a few of the test views (or their replacements) in which some pixel counts, and the
    /// Gaussians left out, summed over them.
    async fn quality(&self, At { on, splats, settings, effects }: At<'_, R, Scene3d>) -> Result<Quality, Error> {
        let render = shown(settings, &effects);
        let views = self.measured_views();
        views.iter().for_each(|view| view.source.read_ahead());
        let (mut l1, mut psnr, mut culled) = (Vec::new(), Vec::new(), Culled::default());
        for view in &views {
            let (rendered, left_out) = on.draw(splats, &view.camera, &render).await?;
            culled = culled.plus(left_out);
            if let Some(pair) = measure(&rendered, view.image()?, render.background_color())? {
                let measured = pair.l1_and_psnr()?;
                l1.push(measured.0);
                psnr.push(measured.1);
            }
        }
        if l1.is_empty() {
            return Err(Error::NothingCounts { views: views.len() });
        }
        Ok(Quality { l1: mean(l1), psnr: mean(&psnr), culled, clamped: Clamped::default(), views: psnr })
    }
}

/// Settings for rendering a scene that was trained with these effects.
pub(crate) fn shown(settings: &TrainSettings, effects: &Effects) -> RenderSettings {
    settings.render.with(|s| s.effects = *effects)
}
