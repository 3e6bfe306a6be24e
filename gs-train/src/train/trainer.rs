//! Starting, resuming and evaluating the training of a 3D scene.

use gs_core::{Camera, Image, Optimizer, Parameterization, RenderSettings, Scene, Scene3d, SplatsState};
use gs_io::{Checkpoint, dataset::AlphaMeaning};
use web_time::Instant;

use super::{
    depth_loss::{DepthMapCounts, Guides},
    evaluation::{Evaluation, Look, Matching, TrainingViews, evaluate_splats},
    exposure::{Exposure, ExposureReport, Exposures},
    poses::{Poses, PosesReport, RefinePoses},
    settings::TrainSettings,
    task::{ViewsTask, check_images, shown},
};
use crate::{
    error::Error,
    run::{Average, Record, Trainer, digest, random},
};
use crate::{
    start::Start,
    views::{Counting, PosedView, Views, extent_of},
};

/// The training of a 3D scene, in progress.
pub type Trainer3d<'a, R> = Trainer<'a, R, Scene3d>;

/// Checks that not all of so many Gaussians are fixed.
fn check_fixed(settings: &TrainSettings, gaussians: usize) -> Result<(), gs_core::Error> {
    match settings.fixed as usize {
        0 => Ok(()),
        fixed if fixed < gaussians => Ok(()),
        fixed => {
            let found = format!("{fixed} of {gaussians}");
            Err(gs_core::Error::setting("number of fixed Gaussians", found, "less than that of all"))
        }
    }
}

impl<'a, R: Optimizer<Scene3d>> Trainer<'a, R, Scene3d> {
    /// Starts a training.
    ///
    /// # Errors
    /// [`gs_core::Error::Setting`] where a setting, a camera or the start is not possible;
    /// [`Error::NothingInView`] where no training view shows any of the first Gaussians; those of
    /// the backend.
    pub async fn from_views(
        rasterizer: &'a R,
        views: Views,
        start: Start,
        mut settings: TrainSettings,
    ) -> Result<Self, Error> {
        let started = Instant::now();
        settings.validate()?;
        views.validate()?;
        if settings.exposure == Exposure::Affine && views.train.len() < 2 {
            let allowed = "off or auto with a single training view, whose exposure differs from no other";
            return Err(gs_core::Error::setting("exposure", "affine", allowed).into());
        }
        if settings.refine_poses != RefinePoses::Off && views.train.iter().any(|view| view.source.is_face()) {
            let allowed = "off with 360° images or wide fish-eyes, whose views share a camera";
            return Err(gs_core::Error::setting("refine-poses", settings.refine_poses, allowed).into());
        }
        settings.remove_unseen &= !matches!(start, Start::Scene(_));
        let cameras: Vec<Camera> = views.train_cameras().copied().collect();
        if settings.fixed > 0 && !matches!(start, Start::Scene(_)) {
            return Err(
                gs_core::Error::setting("number of fixed Gaussians", settings.fixed, "0 without a scene").into()
            );
        }
        let mut views = views.cached();
        let mut start = start.searched(&views.train)?;
        let points = start.points(&settings.init);
        settings = settings.for_points(points);
        if settings.init.far_points.unwrap_or_else(|| views.train.iter().any(|view| view.source.is_face())) {
            start = start.with_shell(&views.train)?;
        }
        let (budget, degree) = (settings.gaussians as usize, settings.render.effects.sh_degree);
        let mut scene = start.scene(&cameras, &settings.init, budget, degree, &mut random(settings.seed, 0))?;
        let mut gaussians = scene.means.iter().zip(&scene.log_scales);
        if !gaussians.any(|(mean, scales)| cameras.iter().any(|camera| sees(camera, *mean, scales.max_element()))) {
            return Err(Error::NothingInView { gaussians: scene.len(), views: cameras.len() });
        }
        check_fixed(&settings, scene.len())?;
        let extent = *settings.extent.get_or_insert_with(|| extent_of(&cameras, &scene.means));
        settings.validate()?;
        let images = fingerprint(&views);
        let poses = Poses::at_start(rasterizer, &mut views, (&mut scene, extent), &settings).await?;
        let splats = rasterizer.upload(&scene, Parameterization::ScaleRotation)?;
        let guides = match settings.depth_loss.is_off() {
            true => Guides::default(),
            false => Guides::of(&views.train, &scene.means)?,
        };
        let record = Record::beginning(settings, images);
        let task = ViewsTask::new(views, &[], extent, (Exposures::default(), poses), guides);
        let mut trainer = Self::assemble(rasterizer, record, splats, task);
        trainer.record.seconds = started.elapsed().as_secs_f64();
        Ok(trainer)
    }

    /// Changes the number of steps of this run to `iterations`, or one more than are done if it is less.
    /// What depends on the share of the steps that are done, such as the learning rate of positions,
    /// goes on at the new share. A mean of the last scenes begins again.
    pub fn end_after(&mut self, iterations: u32) {
        self.record.settings.iterations = iterations.max(self.record.step + 1);
        self.forget_average();
    }

    /// Resumes a training from a checkpoint. On the same backend it ends bit for bit as if it had
    /// never stopped, unless it restarts ([`Recovery`](crate::Recovery)).
    ///
    /// # Errors
    /// [`Error::WrongTarget`] for other views, [`Error::OtherImages`] for other images of them,
    /// [`Error::Checkpoint`] for metadata that are not those of a training in 3D, and those of the
    /// backend.
    pub fn resume_views(rasterizer: &'a R, views: Views, checkpoint: Checkpoint) -> Result<Self, Error> {
        let record = Record::from_metadata::<Scene3d>(&checkpoint.metadata)?;
        views.validate()?;
        let found = fingerprint(&views);
        if record.images != found {
            return Err(Error::WrongTarget { expected: record.images, found });
        }
        let mut views = views.cached();
        let digests = views.digests()?;
        check_images(&checkpoint.metadata, &views, &digests)?;
        let Some(extent) = record.settings.extent else {
            return Err(Error::Checkpoint("its settings lack the extent".to_owned()));
        };
        let average = Average::of_state(&checkpoint.state, record.settings.fixed, SplatsState::scene_3d)?;
        let splats = rasterizer.restore(&checkpoint.state)?;
        check_fixed(&record.settings, rasterizer.len(&splats))
            .map_err(|error| Error::Checkpoint(format!("of its settings, {error}")))?;
        let exposures = Exposures::from_metadata(&checkpoint.metadata, views.train.len())?;
        let poses = Poses::from_metadata(&checkpoint.metadata, &mut views.train)?;
        let guides = Guides::from_metadata(&checkpoint.metadata, views.train.len())?;
        let task = ViewsTask::new(views, &digests, extent, (exposures, poses), guides);
        let mut trainer = Self::assemble(rasterizer, record, splats, task);
        trainer.average = average;
        Ok(trainer)
    }

    /// Returns this training with these colour maps of its images.
    #[cfg(feature = "edit")]
    pub(crate) fn with_exposures(mut self, exposures: Exposures) -> Self {
        self.task.exposures = exposures;
        self
    }

    /// The views.
    pub fn views(&self) -> &Views {
        self.task.views()
    }

    /// The test views; without any, a few of the training views.
    pub fn evaluation_views(&self) -> Vec<&PosedView> {
        self.task.evaluation_views()
    }

    /// Settings for rendering the scene, with the effects that it has been trained with.
    pub fn shown(&self) -> RenderSettings {
        shown(&self.record.settings, &self.effects())
    }

    /// What was found about the exposure of the training views; `None` before the first solution, or
    /// where it is [`Exposure::Off`](super::Exposure::Off).
    pub fn exposure(&self) -> Option<ExposureReport> {
        self.task.exposure_report()
    }

    /// What was found about the poses of the training views' cameras, from the start of the run on; `None` where they
    /// are not refined or the run is too short for it ([`RefinePoses`](super::RefinePoses)).
    pub fn poses(&self) -> Option<PosesReport> {
        self.task.poses_report()
    }

    /// Numbers of the training views' depth maps; `None` without any, or where they are not part of the
    /// loss ([`DepthLoss`](super::DepthLoss)).
    pub fn depth_maps(&self) -> Option<DepthMapCounts> {
        self.task.depth_maps()
    }

    /// The views that [`Self::quality`] measures: at most [`Views::most_measured`] of
    /// [`Self::evaluation_views`], evenly spread.
    pub fn measured_views(&self) -> Vec<&PosedView> {
        self.task.measured_views()
    }

    /// Renders the current scene for a camera, not clamped.
    ///
    /// # Errors
    /// Those of the backend.
    pub async fn render_view(&self, camera: &Camera) -> Result<Image, Error> {
        Ok(self.rasterizer.draw(&self.splats, camera, &self.shown()).await?.0)
    }

    /// Evaluates the scene on [`Self::evaluation_views`], which `look` receives, too.
    ///
    /// # Errors
    /// Those of the backend, of reading an image, and of `look`.
    pub async fn evaluate(&self, look: &Look<'_>) -> Result<Evaluation, Error> {
        let refined = self.poses().is_some_and(|poses| poses.used);
        self.evaluate_matched(if refined { Matching::Poses } else { Matching::Colors }, look).await
    }

    /// [`Self::evaluate`], also at poses that are aligned to the left halves of the images
    /// ([`PoseMatched`](super::PoseMatched)), whether or not this run refines poses.
    ///
    /// # Errors
    /// Those of [`Self::evaluate`].
    pub async fn evaluate_aligned(&self, look: &Look<'_>) -> Result<Evaluation, Error> {
        self.evaluate_matched(Matching::Poses, look).await
    }

    async fn evaluate_matched(&self, matching: Matching, look: &Look<'_>) -> Result<Evaluation, Error> {
        let views = self.task.evaluation_views();
        evaluate_splats(self.rasterizer, &self.splats, (&views, matching), &self.shown(), look).await
    }

    /// Quality on a sample of the training views.
    ///
    /// # Errors
    /// Those of the backend, and of reading an image.
    pub(crate) async fn training_views(&self) -> Result<TrainingViews, Error> {
        self.task.training_views(self.at()).await
    }
}

/// Smallest size of a Gaussian in a view that sees it, px: those of a scene in the coordinates of
/// another data set may be thousands of kilometres away.
const SMALLEST_PX: f32 = 1e-4;

fn sees(camera: &Camera, mean: glam::Vec3, log_scale: f32) -> bool {
    let size = glam::Vec2::new(camera.width as f32, camera.height as f32);
    camera.project(mean).is_some_and(|(at, depth)| {
        let is_inside = at.cmpge(glam::Vec2::ZERO).all() && at.cmple(size).all();
        is_inside && camera.focal.max_element() * log_scale.exp() >= SMALLEST_PX * depth
    })
}

/// Identifies the views by names, cameras, roles and which pixels count. Their images have
/// [checksums](Views::digests) of their own, so that an error can name those that differ.
fn fingerprint(views: &Views) -> String {
    let mut bytes = Vec::new();
    for (role, views) in [(0, &views.train), (1, &views.test)] {
        for PosedView { name, camera, source } in views {
            bytes.push(role);
            let Counting { alpha, masked } = source.counting();
            match (alpha, masked) {
                (AlphaMeaning::Opacity, false) => {}
                (AlphaMeaning::Opacity, true) => bytes.push(1),
                (AlphaMeaning::Mask, masked) => bytes.push(2 + u8::from(masked)),
            }
            bytes.extend(name.as_bytes());
            let numbers = camera.rotation.to_cols_array().into_iter().chain(camera.translation.to_array());
            let intrinsics = camera.focal.to_array().into_iter().chain(camera.center.to_array()).chain([camera.near]);
            bytes.extend(numbers.chain(intrinsics).flat_map(f32::to_le_bytes));
            bytes.extend([camera.width, camera.height].into_iter().flat_map(u32::to_le_bytes));
        }
    }
    format!("{} views and {} held out, {:016x}", views.train.len(), views.test.len(), digest(bytes))
}
