//! The training loop: steps of the optimiser, rounds of density control between them, and checkpoints from which a run goes on
//! bit for bit.

use std::{fmt, sync::Arc, time::Instant};

use gs_core::{
    Binning, Blend, Canvas, DensityStatistics, EditPlan, Image, Loss, PlanarGaussian, PlanarScene, Rasterizer, Scene,
    TrainStep, Wait,
    edit::{AfterEdit, EditCounts, PruneCause, Removal},
    effects::Statistics,
    statistics::Culled,
};
use gs_density::{DensityPolicy, Observation, Residual, Rng};
use gs_io::Checkpoint;
use rand::SeedableRng;

use crate::{
    checkpoint::{FitRecord, fingerprint},
    error::{Error, Suspect},
    losses::Losses,
    observer::{Control, Observer, Progress, Quality},
    quality::l1_and_psnr,
    settings::FitSettings,
    summary::FitSummary,
};

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// All steps are done.
    Finished,
    /// An observer asked to stop; the run can be resumed from a checkpoint taken now.
    Stopped,
}

/// A fit of planar Gaussians to an image, in progress.
///
/// A run is a function of settings, target and backend. What it depends on at a step from which it can be resumed is in the
/// cloud's state, the settings and the step: random numbers are drawn afresh from (seed, step) in each round, and lists of which
/// Gaussian touches which pixels are never carried over such a step.
pub struct Trainer<'a, R: Rasterizer<PlanarScene>> {
    rasterizer: &'a R,
    record: FitRecord,
    canvas: Canvas,
    cloud: R::Cloud,
    target: R::Target,
    /// The target on the host, beside the rendering that the policy last asked for (before that, a single pixel).
    residual: Residual,
    /// What the next step does about its lists.
    binning: Binning,
    losses: Losses,
    /// In place of the settings' policy.
    foreign: Option<ForeignPolicy>,
}

/// A policy from outside of this project, which settings cannot name.
pub type ForeignPolicy = Arc<dyn DensityPolicy + Send + Sync>;

impl<R: Rasterizer<PlanarScene>> fmt::Debug for Trainer<'_, R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Trainer")
            .field("backend", &self.rasterizer.describe())
            .field("record", &self.record)
            .field("canvas", &self.canvas)
            .field("count", &self.count())
            .finish_non_exhaustive()
    }
}

impl<'a, R: Rasterizer<PlanarScene>> Trainer<'a, R> {
    /// Begins a fit with the scene that [`FitSettings::init`] makes for the target.
    ///
    /// # Errors
    /// [`gs_core::Error::Setting`] where a setting is not possible or the target is not finite, and those of the backend.
    pub fn new(rasterizer: &'a R, target: &Image, settings: FitSettings) -> Result<Self, Error> {
        settings.validate()?;
        let started = Instant::now();
        let count = settings.initial.resolve(settings.gaussians) as usize;
        let blend = settings.render.effects.blend;
        let scene = settings.init.scene(target, count, blend, &mut random(settings.seed, 0));
        let initialised = started.elapsed().as_secs_f64();
        let mut trainer = Self::from_scene(rasterizer, target, &scene, settings)?;
        trainer.record.seconds += initialised;
        Ok(trainer)
    }

    /// Begins a fit with a given scene instead, whatever [`FitSettings::init`] and [`FitSettings::initial`] say.
    ///
    /// # Errors
    /// Those of [`Trainer::new`]; also where the scene has more Gaussians than [`FitSettings::gaussians`] allows.
    pub fn from_scene(
        rasterizer: &'a R,
        target: &Image,
        scene: &PlanarScene,
        settings: FitSettings,
    ) -> Result<Self, Error> {
        settings.validate()?;
        validate_target(target)?;
        scene.validate()?;
        if scene.len() > settings.gaussians as usize {
            let allowed = "at most the number of Gaussians allowed";
            return Err(gs_core::Error::setting("the number of Gaussians at the start", scene.len(), allowed).into());
        }
        let started = Instant::now();
        let cloud = rasterizer.upload(scene, settings.chart)?;
        let record =
            FitRecord { settings, step: 0, seconds: 0.0, edits: EditCounts::default(), target: fingerprint(target) };
        let mut trainer = Self::assemble(rasterizer, target, record, cloud)?;
        trainer.solve_colors(trainer.record.settings.color_solve.at_start)?;
        trainer.record.seconds = started.elapsed().as_secs_f64();
        Ok(trainer)
    }

    /// Goes on with a fit where a checkpoint left it; on the same backend it ends bit for bit as if it had never stopped.
    ///
    /// # Errors
    /// [`Error::WrongTarget`] for an image of another size or content, [`Error::Checkpoint`] for metadata that are not those of
    /// a fit, and those of the backend.
    pub fn resume(rasterizer: &'a R, target: &Image, checkpoint: Checkpoint) -> Result<Self, Error> {
        let record = FitRecord::from_metadata(&checkpoint.metadata)?;
        validate_target(target)?;
        let found = fingerprint(target);
        if record.target != found {
            return Err(Error::WrongTarget { expected: record.target, found });
        }
        let cloud = rasterizer.restore(&checkpoint.state)?;
        Self::assemble(rasterizer, target, record, cloud)
    }

    fn assemble(rasterizer: &'a R, target: &Image, record: FitRecord, cloud: R::Cloud) -> Result<Self, Error> {
        let canvas = Canvas::new(target.width(), target.height());
        let residual = Residual { target: target.clone(), rendered: Image::filled(1, 1, [0.0; 3])? };
        let target = rasterizer.upload_target(target)?;
        let losses = Losses::after(record.step);
        let binning = Binning::Fresh;
        Ok(Self { rasterizer, record, canvas, cloud, target, residual, binning, losses, foreign: None })
    }

    /// The same fit with its density controlled by another policy, one of your own, in place of that of its settings.
    /// A checkpoint does not hold it: a resumed fit must be given it again.
    #[must_use]
    pub fn controlled_by(self, policy: ForeignPolicy) -> Self {
        Self { foreign: Some(policy), ..self }
    }

    fn policy(&self) -> &dyn DensityPolicy {
        match &self.foreign {
            Some(policy) => policy.as_ref(),
            None => &self.record.settings.policy,
        }
    }

    /// Steps until the last, or until an observer stops it.
    ///
    /// # Errors
    /// [`Error::Diverged`], those of the backend, and what an observer returns.
    pub fn run(&mut self, observer: &mut dyn Observer) -> Result<Outcome, Error> {
        let (mut stop, mut checkpoint) = (false, false);
        while !self.is_finished() {
            let mut progress = self.step_once()?;
            if let Some(counts) = &progress.edits {
                observer.on_edit(&progress, counts);
            }
            if observer.wants_quality(&progress) {
                self.settle()?;
                progress = Progress { quality: Some(self.quality()?), ..self.progress(progress.edits)? };
            }
            stop |= observer.on_step(&progress) == Control::Stop;
            checkpoint |= observer.wants_checkpoint(&progress);
            let ends_here = (stop || checkpoint) && self.can_checkpoint();
            if ends_here {
                self.settle()?;
            }
            self.tell_losses(observer);
            if checkpoint && ends_here {
                observer.on_checkpoint(&mut self.checkpoint()?)?;
                checkpoint = false;
            }
            if stop && ends_here && !self.is_finished() {
                return Ok(Outcome::Stopped);
            }
        }
        Ok(Outcome::Finished)
    }

    /// One step of the optimiser, and the round of density control that follows it, if one is due. The step itself may still be under
    /// way; a round, the first step of a run and its last wait for all that there are.
    ///
    /// # Errors
    /// [`Error::Diverged`] where the loss of this or of an earlier step is not finite, [`Error::Finished`] after the last step, and those
    /// of the backend.
    pub fn step_once(&mut self) -> Result<Progress, Error> {
        let iterations = self.record.settings.iterations;
        if self.is_finished() {
            return Err(Error::Finished { iterations });
        }
        self.check_divergence()?;
        self.losses.forget_untold();
        let started = Instant::now();
        self.optimise()?;
        self.record.step += 1;
        let due = self.record.settings.rounds.progress(self.record.step, iterations);
        let settled = due.is_some() || self.is_finished() || self.losses.last().is_none();
        self.see_losses(if settled { Wait::All } else { Wait::Arrived })?;
        let fresh = self.record.settings.bins_afresh_after(self.record.step);
        self.binning = if fresh { Binning::Fresh } else { Binning::Reuse };
        let mut edits = due.map(|progress| self.control_density(progress)).transpose()?;
        self.add_noise()?;
        if self.is_finished() {
            self.drop_not_finite(&mut edits)?;
        }
        self.record.seconds += started.elapsed().as_secs_f64();
        self.progress(edits)
    }

    /// Where the fit stands.
    fn progress(&self, edits: Option<EditCounts>) -> Result<Progress, Error> {
        let loss = self.losses.last().ok_or_else(|| self.missing_losses())?;
        Ok(Progress {
            step: self.record.step,
            iterations: self.record.settings.iterations,
            seconds: self.record.seconds,
            count: self.count(),
            loss,
            loss_step: self.losses.seen(),
            edits,
            psnr_estimate: (self.record.settings.loss == Loss::L2).then(|| -10.0 * loss.log10()),
            quality: None,
        })
    }

    /// Forward, backward and Adam, sent on their way.
    fn optimise(&mut self) -> Result<(), Error> {
        let FitRecord { settings, step, .. } = &self.record;
        let mut render = settings.render;
        // Statistics that no round will look at are not collected.
        render.effects.statistics = match *step < settings.rounds.last(settings.iterations) {
            true => self.policy().statistics(),
            false => Statistics::None,
        };
        let rates = settings.adam.at(*step as f32 / settings.iterations as f32);
        let step = TrainStep { settings: &render, loss: settings.loss, rates: &rates, binning: self.binning };
        Ok(self.rasterizer.train_step(&mut self.cloud, &self.canvas, &self.target, &step)?)
    }

    /// Looks at the losses that have come, or waits for all.
    fn see_losses(&mut self, wait: Wait) -> Result<(), Error> {
        self.losses.see(|list| self.rasterizer.losses(&mut self.cloud, wait, list))?;
        self.check_divergence()?;
        match wait == Wait::All && self.losses.seen() != self.record.step {
            true => Err(self.missing_losses()),
            false => Ok(()),
        }
    }

    fn missing_losses(&self) -> Error {
        let (seen, step) = (self.losses.seen(), self.record.step);
        gs_core::Error::State(format!("the backend has told the losses of {seen} steps out of {step}")).into()
    }

    /// Waits for the steps under way, which is time spent fitting, and sees their losses.
    fn settle(&mut self) -> Result<(), Error> {
        let started = Instant::now();
        self.see_losses(Wait::All)?;
        self.record.seconds += started.elapsed().as_secs_f64();
        Ok(())
    }

    fn check_divergence(&self) -> Result<(), Error> {
        match self.losses.diverged() {
            None => Ok(()),
            Some((step, loss)) => Err(Error::Diverged { step, loss, suspect: self.suspect() }),
        }
    }

    fn tell_losses(&mut self, observer: &mut dyn Observer) {
        let (first_step, losses) = self.losses.untold();
        if !losses.is_empty() {
            observer.on_losses(first_step, losses);
            self.losses.forget_untold();
        }
    }

    /// Shows the scene to the policy and does what it says; `progress` as in [`Observation`].
    fn control_density(&mut self, progress: f32) -> Result<EditCounts, Error> {
        let FitRecord { settings, step, .. } = &self.record;
        let scene = self.rasterizer.download(&self.cloud)?;
        let statistics = match self.policy().statistics() {
            Statistics::None => DensityStatistics::zeros(scene.len()),
            _ => self.rasterizer.statistics(&self.cloud)?,
        };
        let needs_residual = self.policy().needs_residual();
        if needs_residual {
            self.residual.rendered = self.render()?.0;
        }
        let observation = Observation {
            scene: &scene,
            statistics: &statistics,
            residual: needs_residual.then_some(&self.residual),
            size: self.residual.target.size(),
            step: step - 1,
            progress,
            budget: settings.gaussians as usize,
        };
        let plan = self.policy().plan(&observation, &mut random(settings.seed, *step))?;
        let counts = plan.counts();
        self.rasterizer.edit(&mut self.cloud, &plan)?;
        self.record.edits.accumulate(&counts);
        self.binning = Binning::Fresh;
        self.solve_colors(self.record.settings.color_solve.after_edit)?;
        Ok(counts)
    }

    /// Adds the noise that the policy asks for after this step; not after the last, which nothing would mend.
    fn add_noise(&mut self) -> Result<(), Error> {
        let FitRecord { settings, step, .. } = &self.record;
        let Some(noise) = self.policy().noise().filter(|noise| noise.is_due(*step) && !self.is_finished()) else {
            return Ok(());
        };
        let rate = settings.adam.mean.schedule.factor(*step as f32 / settings.iterations as f32);
        let scene = self.rasterizer.download(&self.cloud)?;
        let mut rng = Rng::new(u128::from(settings.seed) << 32 | u128::from(*step), NOISE_STREAM);
        if let Some(shifts) = noise.shifts(&scene, self.residual.target.size(), rate, &mut rng) {
            self.rasterizer.shift_means(&mut self.cloud, &shifts)?;
        }
        Ok(())
    }

    /// Takes out what has become NaN or infinite since the last round; it draws nothing, and no file would take it.
    fn drop_not_finite(&mut self, edits: &mut Option<EditCounts>) -> Result<(), Error> {
        let scene = self.rasterizer.download(&self.cloud)?;
        let finite = |g: &PlanarGaussian| {
            let shape = g.mean.is_finite() && g.log_scale.is_finite() && g.rotation.is_finite();
            shape && g.color.is_finite() && !g.opacity_logit.is_nan()
        };
        let lost = scene.iter().enumerate().filter(|(_, g)| !finite(g)).map(|(i, _)| i as u32);
        let removed: Vec<Removal> = lost.map(|index| Removal { index, cause: PruneCause::NotFinite }).collect();
        if !removed.is_empty() {
            let plan = EditPlan { removed, statistics: AfterEdit::Keep, ..EditPlan::default() };
            self.rasterizer.edit(&mut self.cloud, &plan)?;
            let counts = plan.counts();
            self.record.edits.accumulate(&counts);
            edits.get_or_insert_default().accumulate(&counts);
        }
        Ok(())
    }

    fn solve_colors(&mut self, iterations: u32) -> Result<(), Error> {
        let render = self.record.settings.render;
        if iterations > 0 && render.effects.blend == Blend::Sum && self.count() > 0 {
            self.rasterizer.solve_colors(&mut self.cloud, &self.canvas, &self.target, &render, iterations)?;
        }
        Ok(())
    }

    /// The Gaussian to name when the loss is not finite: the first whose parameters are not, or else the one with the largest.
    fn suspect(&self) -> Option<Box<Suspect>> {
        let scene = self.scene().ok()?;
        let worst = |g: &PlanarGaussian| {
            let values = [g.mean.to_array(), g.log_scale.to_array(), [g.rotation, 0.0]];
            let largest = values
                .as_flattened()
                .iter()
                .chain(&g.color.to_array())
                .fold(0.0f32, |m, v| if v.is_finite() { m.max(v.abs()) } else { f32::INFINITY });
            if g.opacity_logit.is_nan() { f32::INFINITY } else { largest }
        };
        let not_finite = scene.iter().filter(|g| worst(g) == f32::INFINITY).count();
        // The first of several equals.
        let found = scene.iter().enumerate().reduce(|a, b| if worst(&b.1) > worst(&a.1) { b } else { a });
        found.map(|(index, gaussian)| Box::new(Suspect { index, gaussian, not_finite }))
    }

    /// L1, PSNR and what was left out, from a rendering made for it.
    ///
    /// # Errors
    /// Those of the backend.
    pub fn quality(&self) -> Result<Quality, Error> {
        let (image, culled) = self.render()?;
        let (l1, psnr) = l1_and_psnr(&image, &self.residual.target);
        Ok(Quality { l1, psnr, culled })
    }

    /// The fit as it stands, in numbers.
    ///
    /// # Errors
    /// Those of the backend.
    pub fn summary(&self) -> Result<FitSummary, Error> {
        let (image, culled) = self.render()?;
        FitSummary::new(self, &image, culled)
    }

    /// The scene as rendered now at the target's size, not clamped, and what was left out.
    ///
    /// # Errors
    /// Those of the backend.
    pub fn render(&self) -> Result<(Image, Culled), Error> {
        let mut render = self.record.settings.render;
        render.effects.statistics = Statistics::None;
        let frame = self.rasterizer.forward(&self.cloud, &self.canvas, &render)?;
        Ok((self.rasterizer.image(&frame)?, self.rasterizer.culled(&frame)?))
    }

    /// The scene as it is now.
    ///
    /// # Errors
    /// Those of the backend.
    pub fn scene(&self) -> Result<PlanarScene, Error> {
        Ok(self.rasterizer.download(&self.cloud)?)
    }

    /// Whether the next step makes its lists anew, so that nothing but the cloud, the settings and the step matters to it; or
    /// whether there is no next step.
    pub fn can_checkpoint(&self) -> bool {
        self.binning == Binning::Fresh || self.is_finished()
    }

    /// All that is needed to go on later, with [`Trainer::resume`]. Waits for the steps under way: a checkpoint is only made of a state
    /// that finite losses led to.
    ///
    /// # Errors
    /// [`Error::BetweenCheckpoints`] where [`Trainer::can_checkpoint`] is false, [`Error::Diverged`], [`Error::Checkpoint`] for
    /// settings that cannot be stored, and those of the backend.
    pub fn checkpoint(&mut self) -> Result<Checkpoint, Error> {
        if !self.can_checkpoint() {
            let FitRecord { settings, step, .. } = &self.record;
            let next = (step + 1..).find(|&next| settings.bins_afresh_after(next)).unwrap_or(settings.iterations);
            return Err(Error::BetweenCheckpoints { step: *step, next });
        }
        self.settle()?;
        Ok(Checkpoint { state: self.rasterizer.save(&self.cloud)?, metadata: self.record.to_metadata()? })
    }

    /// Steps done.
    pub fn step(&self) -> u32 {
        self.record.step
    }

    /// Whether all steps are done.
    pub fn is_finished(&self) -> bool {
        self.record.step >= self.record.settings.iterations
    }

    /// Gaussians now.
    pub fn count(&self) -> u32 {
        self.rasterizer.len(&self.cloud) as u32
    }

    /// The settings of this fit.
    pub fn settings(&self) -> &FitSettings {
        &self.record.settings
    }

    /// The target, as given.
    pub fn target(&self) -> &Image {
        &self.residual.target
    }

    /// The backend's name and what it runs on.
    pub fn backend(&self) -> String {
        self.rasterizer.describe()
    }

    /// What density control has done so far, all rounds together.
    pub fn edits(&self) -> &EditCounts {
        &self.record.edits
    }

    /// The loss before the last step whose loss has come, as in [`Progress::loss`]; nothing where this run, resumed or not, has made no
    /// step yet.
    pub fn loss(&self) -> Option<f32> {
        self.losses.last()
    }

    /// The losses that have come since the last [`Trainer::step_once`] began, in the order of their steps, and the first of these steps,
    /// counted from 1. From step to step they are the losses of all steps, each once; [`Trainer::run`] tells them to its observer.
    pub fn new_losses(&self) -> (u32, &[f32]) {
        self.losses.untold()
    }

    /// Time spent fitting so far, s; see [`Progress::seconds`].
    pub fn seconds(&self) -> f64 {
        self.record.seconds
    }
}

/// Which of the generator's streams the noise between steps is drawn from, so that it is independent of the rounds' draws.
const NOISE_STREAM: u128 = 0x6e_6f69_7365;

/// The random numbers of the initialiser (step 0) or of the round after a step (counted from 1).
fn random(seed: u32, step: u32) -> Rng {
    Rng::seed_from_u64(u64::from(seed) << 32 | u64::from(step))
}

fn validate_target(target: &Image) -> Result<(), gs_core::Error> {
    match target.pixels().iter().position(|p| !p.iter().all(|v| v.is_finite())) {
        None => Ok(()),
        Some(index) => {
            let width = target.width() as usize;
            let value = format!("{:?} at ({}, {})", target.pixels()[index], index % width, index / width);
            Err(gs_core::Error::setting("a pixel of the target", value, "finite"))
        }
    }
}
