//! The task of fitting 2D Gaussians to one image.

use bytemuck::cast_slice_mut;
use gs_core::{
    Blend, Canvas, Culled, Effects, Gaussian2d, Image, Loss, Optimizer, Parameterization, RenderSettings, Scene,
    Scene2d, TargetImage, TrainStep,
    metrics::{l1_and_psnr, psnr_of_mse},
};
use gs_density::Residual;
use gs_io::Checkpoint;
use web_time::Instant;

use super::whole_fit::FitTarget;
use super::{settings::FitSettings, summary::FitSummary};
use crate::{
    error::Error,
    run::{
        At, Clamped, Quality, Record, RunSettings, StepContext, Trainable, Trainer, TrainingTask, random, same_settings,
    },
};

/// The image to fit, where the backend computes and on the host.
pub struct ImageTask<R: Optimizer<Scene2d>> {
    canvas: Canvas,
    target: R::Target,
    /// The target on the host, with the rendering of the current round of density control; between
    /// rounds that is one pixel.
    residual: Residual,
}

impl<R: Optimizer<Scene2d>> std::fmt::Debug for ImageTask<R> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ImageTask").field("canvas", &self.canvas).finish_non_exhaustive()
    }
}

impl Trainable for Scene2d {
    type Settings = FitSettings;
    type TrainingTask<R: Optimizer<Self>> = ImageTask<R>;

    fn parameters(g: &Gaussian2d) -> Vec<(&'static str, Vec<f32>)> {
        vec![
            ("mean (px)", g.mean.to_array().to_vec()),
            ("ln-scale", g.log_scale.to_array().to_vec()),
            ("rotation", vec![g.rotation]),
            ("colour", g.color.to_array().to_vec()),
        ]
    }

    fn log_scale_range(&self, index: usize) -> (f32, f32) {
        (self.log_scales[index].min_element(), self.log_scales[index].max_element())
    }

    fn numbers_mut(&mut self) -> Vec<&mut [f32]> {
        let Self { means, log_scales, rotations, opacity_logits, colors } = self;
        let [means, log_scales] = [means, log_scales].map(|vectors| cast_slice_mut(vectors));
        vec![means, log_scales, rotations, opacity_logits, cast_slice_mut(colors)]
    }
}

impl RunSettings<Scene2d> for FitSettings {
    const FORMAT: &'static str = "fit-2d-1";

    same_settings!(Scene2d);

    fn parameterization(&self) -> Parameterization {
        self.parameterization
    }

    fn effects_after(&self, _: u32) -> Effects {
        self.render.effects
    }

    fn mean_factor(&self, step: u32) -> f32 {
        self.adam.mean.schedule.factor(step as f32 / self.iterations as f32)
    }

    fn scale_bounds(&self) -> (f32, f32) {
        (self.adam.min_scale, self.adam.max_scale)
    }

    fn bins_afresh_after(&self, step: u32) -> bool {
        step.is_multiple_of(self.rebin_every) || step.saturating_add(self.rebin_every) >= self.iterations
    }
}

impl<R: Optimizer<Scene2d>> TrainingTask<R, Scene2d> for ImageTask<R> {
    const HAS_VIEWS: bool = false;

    fn extent(&self) -> f32 {
        self.canvas.width.max(self.canvas.height) as f32
    }

    fn images(&self) -> u32 {
        1
    }

    fn psnr_estimate(&self, settings: &FitSettings, loss: f32) -> Option<f32> {
        let is_squares = settings.loss == Loss::L2 && self.residual.weights.is_none();
        is_squares.then(|| psnr_of_mse(loss.into()) as f32)
    }

    async fn send(
        &mut self,
        on: &R,
        splats: &mut R::Splats,
        settings: &FitSettings,
        context: StepContext,
    ) -> Result<(), Error> {
        let render = settings.render.with(|s| s.effects = context.effects);
        let rates = settings.adam.at(context.step as f32 / settings.iterations as f32).times(context.lr_scale);
        let step = TrainStep { settings: &render, loss: settings.loss, rates: &rates, binning: context.binning };
        Ok(on.train_step(splats, &self.canvas, &self.target, &step).await?)
    }

    async fn residual(&mut self, at: At<'_, R, Scene2d>) -> Result<Option<&Residual>, Error> {
        self.residual.rendered = self.render(at).await?.0;
        Ok(Some(&self.residual))
    }

    async fn after_edit(
        &mut self,
        on: &R,
        splats: &mut R::Splats,
        settings: &FitSettings,
        effects: &Effects,
    ) -> Result<(), Error> {
        self.residual.rendered = nothing_rendered()?;
        self.solve_colors(on, splats, settings, effects, settings.color_solve.after_edit).await
    }

    async fn quality(&self, at: At<'_, R, Scene2d>) -> Result<Quality, Error> {
        let (image, culled) = self.render(at).await?;
        let (l1, psnr) = l1_and_psnr(&image, &self.residual.target)?;
        Ok(Quality { l1, psnr, culled, clamped: Clamped::default(), views: Vec::new() })
    }
}

impl<R: Optimizer<Scene2d>> ImageTask<R> {
    fn new(on: &R, target: FitTarget<'_>, settings: &FitSettings) -> Result<Self, Error> {
        let (image, weights) = (target.image, target.weights(settings));
        if weights.is_some() && !settings.loss.is_pointwise() {
            return Err(gs_core::Error::setting("the loss of weighted pixels", settings.loss, "l2 or l1").into());
        }
        let canvas = Canvas::new(image.width(), image.height());
        let target = on.upload_target(TargetImage { weights: weights.as_deref(), ..image.into() })?;
        let residual = Residual { target: image.clone(), rendered: nothing_rendered()?, weights };
        Ok(Self { canvas, target, residual })
    }

    async fn render(&self, At { on, splats, settings, effects }: At<'_, R, Scene2d>) -> Result<(Image, Culled), Error> {
        Ok(on.draw(splats, &self.canvas, &settings.render.with(|s| s.effects = effects)).await?)
    }

    async fn solve_colors(
        &self,
        on: &R,
        splats: &mut R::Splats,
        settings: &FitSettings,
        effects: &Effects,
        iterations: u32,
    ) -> Result<(), Error> {
        let render = settings.render.with(|s| s.effects = *effects);
        if iterations > 0 && render.effects.blend == Blend::Sum && on.len(splats) > 0 {
            on.solve_colors(splats, &self.canvas, &self.target, &render, iterations).await?;
        }
        Ok(())
    }
}

impl<'a, R: Optimizer<Scene2d>> Trainer<'a, R> {
    /// Starts a fit with the scene that [`FitSettings::init`] makes for the target.
    ///
    /// # Errors
    /// [`gs_core::Error::Setting`] where a setting is not possible, [`gs_core::Error::Pixel`] where
    /// the target is not finite, and those of the backend.
    pub async fn new(
        rasterizer: &'a R,
        target: impl Into<FitTarget<'_>>,
        settings: FitSettings,
    ) -> Result<Self, Error> {
        settings.validate()?;
        let target = target.into();
        let started = Instant::now();
        let count = settings.initial.resolve(settings.gaussians) as usize;
        let blend = settings.render.effects.blend;
        let scene = settings.init.scene(target.image, count, blend, &mut random(settings.seed, 0));
        let initialised = started.elapsed().as_secs_f64();
        let mut trainer = Self::from_scene(rasterizer, target, &scene, settings).await?;
        trainer.record.seconds += initialised;
        Ok(trainer)
    }

    /// Starts a fit with a given scene; [`FitSettings::init`] and [`FitSettings::initial`] are not
    /// used.
    ///
    /// # Errors
    /// Those of [`Trainer::new`]; also where the scene has more Gaussians than
    /// [`FitSettings::gaussians`] allows.
    pub async fn from_scene(
        rasterizer: &'a R,
        target: impl Into<FitTarget<'_>>,
        scene: &Scene2d,
        settings: FitSettings,
    ) -> Result<Self, Error> {
        settings.validate()?;
        let target = target.into();
        target.image.check_finite("the target")?;
        scene.validate()?;
        let allowed = "at most the number of Gaussians allowed";
        let most = settings.gaussians as usize;
        gs_core::Error::within("the number of Gaussians at the start", scene.len(), ..=most, allowed)?;
        let started = Instant::now();
        let splats = rasterizer.upload(scene, settings.parameterization)?;
        let task = ImageTask::new(rasterizer, target, &settings)?;
        let record = Record::beginning(settings, target.fingerprint());
        let mut trainer = Self::assemble(rasterizer, record, splats, task);
        let effects = trainer.effects();
        let Self { task, splats, record, .. } = &mut trainer;
        task.solve_colors(rasterizer, splats, &record.settings, &effects, record.settings.color_solve.at_start).await?;
        trainer.record.seconds = started.elapsed().as_secs_f64();
        Ok(trainer)
    }

    /// Resumes a fit from a checkpoint. On the same backend it ends bit for bit as if it had never
    /// stopped, unless it restarts ([`Recovery`](crate::Recovery)).
    ///
    /// # Errors
    /// [`Error::WrongTarget`] for an image of another size or content, [`Error::Checkpoint`] for
    /// metadata that are not those of a fit, and those of the backend.
    pub fn resume<'t>(
        rasterizer: &'a R,
        target: impl Into<FitTarget<'t>>,
        checkpoint: Checkpoint,
    ) -> Result<Self, Error> {
        let target = target.into();
        let record = Record::<FitSettings>::from_metadata::<Scene2d>(&checkpoint.metadata)?;
        target.image.check_finite("the target")?;
        let found = target.fingerprint();
        if record.images != found {
            return Err(Error::WrongTarget { expected: record.images, found });
        }
        let splats = rasterizer.restore(&checkpoint.state)?;
        let task = ImageTask::new(rasterizer, target, &record.settings)?;
        Ok(Self::assemble(rasterizer, record, splats, task))
    }

    /// Summary of the fit in its current state.
    ///
    /// # Errors
    /// Those of the backend.
    pub async fn summary(&self) -> Result<FitSummary, Error> {
        let (image, culled) = self.render().await?;
        FitSummary::new(self, &image, culled).await
    }

    /// Renders the scene at the target's size, not clamped, and counts the Gaussians left out.
    ///
    /// # Errors
    /// Those of the backend.
    pub async fn render(&self) -> Result<(Image, Culled), Error> {
        self.task.render(self.at()).await
    }

    /// Loss of the current scene, in the unit of the loss of the settings; [`Trainer::loss`] is
    /// that before a step.
    ///
    /// # Errors
    /// Those of the backend.
    pub(super) async fn scene_loss(&self) -> Result<f32, Error> {
        let pass = self.rasterizer.forward(&self.splats, &self.task.canvas, &self.shown()).await?;
        Ok(self.rasterizer.loss(&self.splats, pass, &self.task.target, &self.record.settings.loss).await?)
    }

    /// Settings for rendering the scene, with the effects that it has been fitted with.
    pub fn shown(&self) -> RenderSettings {
        self.record.settings.render.with(|s| s.effects = self.effects())
    }

    /// The target image.
    pub fn target(&self) -> &Image {
        &self.task.residual.target
    }
}

/// The image that stands where nothing has been rendered yet: one black pixel.
fn nothing_rendered() -> Result<Image, gs_core::Error> {
    Image::filled(1, 1, [0.0; 3])
}
