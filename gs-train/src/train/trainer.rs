//! Starting, resuming and evaluating the training of a 3D scene.

use gs_core::{Camera, Image, Optimizer, RenderSettings, Scene3d, SplatsState};
use gs_io::Checkpoint;

use super::{
    beginning::{Beginning, check_fixed, fingerprint},
    evaluation::{Evaluation, Look, Matching, TrainingViews, evaluate_splats},
    exposure::{ExposureReport, Exposures},
    first_poses::first_poses,
    poses::{Poses, PosesReport},
    settings::TrainSettings,
    task::{ViewsTask, check_images, shown},
    trial::{
        report::{Trial, TrialReport},
        trial,
    },
};
use crate::{
    error::Error,
    run::{Average, Record, Trainer},
    start::Start,
    views::{PosedView, Views},
};

/// The training of a 3D scene, in progress.
pub type Trainer3d<'a, R> = Trainer<'a, R, Scene3d>;

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
        settings: TrainSettings,
    ) -> Result<Self, Error> {
        let mut beginning = Beginning::new(views, start, settings)?;
        let Beginning { views, scene, extent, settings, .. } = &mut beginning;
        let poses = first_poses(rasterizer, views, (scene, *extent), settings).await?;
        let trial = trial(rasterizer, views, scene, settings).await?;
        let mut trainer = beginning.trainer(rasterizer, poses)?;
        trainer.task.trial = trial;
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
        let task = ViewsTask::new(views, &digests, extent, (exposures, poses));
        let trial = Trial::from_metadata(&checkpoint.metadata)?;
        let mut trainer = Self::assemble(rasterizer, record, splats, task);
        (trainer.average, trainer.task.trial) = (average, trial);
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

    /// What a trial before the first step found; `None` for a run without a trial
    /// ([`TrainSettings::has_trial`]), or whose trial was too short to decide anything.
    pub fn trial(&self) -> Option<&TrialReport> {
        self.task.trial.as_ref().map(|trial| &trial.report)
    }

    /// The settings with which another run with the same views, start and backend gives the same bits: [`Self::settings`]
    /// before a trial changed them.
    pub fn settings_to_repeat(&self) -> &TrainSettings {
        self.task.trial.as_ref().map_or_else(|| self.settings(), |trial| &trial.given)
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
