//! The training loop: steps of the optimiser, rounds of density control between them, and checkpoints from which a run goes on
//! bit for bit. Shared by every kind of training; what they differ in is their [`TrainingTask`].

mod density;
mod fresh_start;

use std::{fmt, sync::Arc};

use gs_core::{Binning, Effects, Optimizer, Scene2d, Wait, edit::EditCounts, effects::Statistics};
use gs_density::{DensityPolicy, Rng};
use gs_io::Checkpoint;
use rand::SeedableRng;
use web_time::Instant;

use fresh_start::Start;

use crate::{
    checkpoint::Record,
    clamped::Clamped,
    error::Error,
    losses::Losses,
    observer::{Control, Observer, Progress, Quality},
    recovery::{FreshStart, Watch, lr_scale},
    rounds::Rounds,
    suspect::Suspect,
    task::{RunSettings, StepContext, Trainable, TrainingTask},
};

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// All steps are done.
    Finished,
    /// An observer asked to stop; the run can be resumed from a checkpoint taken now.
    Stopped,
}

/// A training in progress: by default a fit of 2D Gaussians to an image; [`Trainer3d`](crate::Trainer3d) is that of a scene in
/// space from views.
///
/// A run is a function of settings, pictures and backend. What it depends on at a step from which it can be resumed is in the
/// splats' state, the settings and the step: random numbers are drawn afresh from (seed, step) in each round, and lists of which
/// Gaussian touches which pixels are never carried over such a step.
pub struct Trainer<'a, R: Optimizer<S>, S: Trainable = Scene2d> {
    pub(crate) rasterizer: &'a R,
    pub(crate) record: Record<S::Settings>,
    pub(crate) splats: R::Splats,
    pub(crate) task: S::TrainingTask<R>,
    /// What the next step does about its lists.
    binning: Binning,
    losses: Losses,
    /// How it goes, and what this run, resumed or not, began with.
    watch: Watch,
    start: Option<Start<S>>,
    /// In place of the settings' policy.
    foreign: Option<ForeignPolicy<S>>,
}

/// A policy from outside of this project, which settings cannot name.
pub type ForeignPolicy<S = Scene2d> = Arc<dyn DensityPolicy<S> + Send + Sync>;

impl<R: Optimizer<S>, S: Trainable> fmt::Debug for Trainer<'_, R, S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Trainer")
            .field("backend", &self.rasterizer.describe())
            .field("record", &self.record)
            .field("count", &self.count())
            .finish_non_exhaustive()
    }
}

impl<'a, R: Optimizer<S>, S: Trainable> Trainer<'a, R, S> {
    /// A run that stands where its record says.
    pub(crate) fn assemble(
        rasterizer: &'a R,
        record: Record<S::Settings>,
        splats: R::Splats,
        task: S::TrainingTask<R>,
    ) -> Self {
        let losses = Losses::after(record.step);
        Self {
            rasterizer,
            record,
            splats,
            task,
            binning: Binning::Fresh,
            losses,
            watch: Watch::default(),
            start: None,
            foreign: None,
        }
    }

    /// The same run with its density controlled by another policy, one of your own, in place of that of its settings.
    /// A checkpoint does not hold it: a resumed run must be given it again.
    #[must_use]
    pub fn controlled_by(self, policy: ForeignPolicy<S>) -> Self {
        Self { foreign: Some(policy), ..self }
    }

    fn policy(&self) -> &dyn DensityPolicy<S> {
        policy(&self.foreign, &self.record.settings)
    }

    /// Steps until the last, or until an observer stops it.
    ///
    /// # Errors
    /// [`Error::Diverged`], those of the backend, and what an observer returns.
    pub async fn run(&mut self, observer: &mut dyn Observer) -> Result<Outcome, Error> {
        let (mut stop, mut checkpoint) = (false, false);
        while !self.is_finished() {
            let mut progress = self.step_once().await?;
            if let Some(counts) = &progress.edits {
                observer.on_edit(&progress, counts);
            }
            if let Some(fresh_start) = &progress.fresh_start {
                observer.on_fresh_start(&progress, fresh_start);
            }
            if observer.wants_quality(&progress) {
                self.settle().await?;
                let Progress { edits, fresh_start, .. } = progress;
                progress = Progress { quality: Some(self.quality().await?), ..self.progress(edits, fresh_start)? };
            }
            stop |= observer.on_step(&progress) == Control::Stop;
            checkpoint |= observer.wants_checkpoint(&progress);
            let ends_here = (stop || checkpoint) && self.can_checkpoint();
            if ends_here {
                self.settle().await?;
            }
            self.tell_losses(observer);
            if checkpoint && ends_here {
                observer.on_checkpoint(&mut self.checkpoint().await?)?;
                checkpoint = false;
            }
            if stop && ends_here && !self.is_finished() {
                return Ok(Outcome::Stopped);
            }
        }
        Ok(Outcome::Finished)
    }

    /// One step of the optimiser, and the round of density control that follows it, if one is due. The step itself may still be under
    /// way; a round, the first step of a run, its last, and those after which it is judged (`Recovery`) wait for all
    /// that there are.
    ///
    /// # Errors
    /// [`Error::Diverged`] where the loss of this or of an earlier step is not finite, [`Error::Finished`] after the last step, and those
    /// of the backend.
    pub async fn step_once(&mut self) -> Result<Progress, Error> {
        let iterations = self.record.settings.iterations();
        if self.is_finished() {
            return Err(Error::Finished { iterations });
        }
        self.check_divergence().await?;
        self.losses.forget_untold();
        let started = Instant::now();
        self.keep_start().await?;
        self.optimise().await?;
        self.record.step += 1;
        let due = self.rounds().progress(self.record.step, iterations);
        let settled = due.is_some() || self.is_judged() || self.is_finished() || self.losses.last().is_none();
        self.see_losses(if settled { Wait::All } else { Wait::Arrived }).await?;
        let fresh = self.record.settings.bins_afresh_after(self.record.step);
        self.binning = if fresh { Binning::Fresh } else { Binning::Reuse };
        let mut edits = match due {
            Some(progress) => Some(self.control_density(progress).await?),
            None => None,
        };
        self.add_noise()?;
        if self.is_finished() {
            self.drop_not_finite(&mut edits).await?;
        }
        let fresh_start = self.begin_again().await?;
        self.record.seconds += started.elapsed().as_secs_f64();
        self.progress(edits, fresh_start)
    }

    /// Where the run stands.
    fn progress(&self, edits: Option<EditCounts>, fresh_start: Option<FreshStart>) -> Result<Progress, Error> {
        let loss = self.losses.last().ok_or_else(|| self.missing_losses())?;
        Ok(Progress {
            step: self.record.step,
            iterations: self.record.settings.iterations(),
            seconds: self.record.seconds,
            count: self.count(),
            loss,
            loss_step: self.losses.seen(),
            edits,
            fresh_start,
            psnr_estimate: self.record.settings.psnr_estimate(loss),
            quality: None,
        })
    }

    /// When density is controlled: no more in a run that has begun again twice.
    fn rounds(&self) -> &Rounds {
        match self.record.fresh_starts.len() {
            0 | 1 => self.record.settings.rounds(),
            _ => &Rounds::NEVER,
        }
    }

    /// Rounds of density control that the Gaussians of the scene have gone through: since the run last began again, if it did.
    pub(crate) fn rounds_of_scene(&self) -> u32 {
        let Record { settings, step, fresh_starts, .. } = &self.record;
        let since = fresh_starts.last().map_or(0, |start| start.step);
        (since + 1..=*step).filter(|&at| self.rounds().progress(at, settings.iterations()).is_some()).count() as u32
    }

    /// Whether a policy stands in for that of the settings.
    pub(crate) fn has_foreign_policy(&self) -> bool {
        self.foreign.is_some()
    }

    /// What is left of the settings' learning rates.
    fn lr_scale(&self) -> f32 {
        lr_scale(self.record.fresh_starts.len())
    }

    /// Forward, backward and Adam, sent on their way.
    async fn optimise(&mut self) -> Result<(), Error> {
        let Record { settings, step, .. } = &self.record;
        // Statistics that no round will look at are not collected.
        let statistics = match *step < self.rounds().last(settings.iterations()) {
            true => self.policy().statistics(),
            false => Statistics::None,
        };
        let effects = Effects { statistics, ..settings.effects_after(*step) };
        let context = StepContext { step: *step, effects, lr_scale: self.lr_scale(), binning: self.binning };
        self.task.send(self.rasterizer, &mut self.splats, settings, context).await
    }

    /// Looks at the losses that have come, or waits for all.
    async fn see_losses(&mut self, wait: Wait) -> Result<(), Error> {
        let (pictures, watch) = (self.task.pictures(), &mut self.watch);
        let list = self.losses.list();
        let known = list.len();
        let added = self.rasterizer.losses(&mut self.splats, wait, list).await;
        // What came before an error counts.
        self.losses.see(known, |step, loss| watch.hear(step, loss, pictures));
        added?;
        self.check_divergence().await?;
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
    async fn settle(&mut self) -> Result<(), Error> {
        let started = Instant::now();
        self.see_losses(Wait::All).await?;
        self.record.seconds += started.elapsed().as_secs_f64();
        Ok(())
    }

    async fn check_divergence(&self) -> Result<(), Error> {
        match self.losses.diverged() {
            None => Ok(()),
            Some((step, loss)) => Err(Error::Diverged {
                step,
                loss,
                suspect: self.scene().await.ok().and_then(|scene| Suspect::of(&scene)).map(Box::new),
            }),
        }
    }

    fn tell_losses(&mut self, observer: &mut dyn Observer) {
        let (first_step, losses) = self.losses.untold();
        if !losses.is_empty() {
            observer.on_losses(first_step, losses);
            self.losses.forget_untold();
        }
    }

    /// How good the scene is now, from renderings made for it.
    ///
    /// # Errors
    /// Those of the backend, and of reading a picture.
    pub async fn quality(&self) -> Result<Quality, Error> {
        let quality = self.task.quality(self.rasterizer, &self.splats, &self.record.settings, &self.effects()).await?;
        Ok(Quality { clamped: self.clamped().await?, ..quality })
    }

    /// How many Gaussians have a scale at one of the optimiser's bounds.
    ///
    /// # Errors
    /// Those of the backend.
    pub async fn clamped(&self) -> Result<Clamped, Error> {
        Ok(Clamped::of(&self.scene().await?, &self.record.settings))
    }

    /// The scene as it is now.
    ///
    /// # Errors
    /// Those of the backend.
    pub async fn scene(&self) -> Result<S, Error> {
        Ok(self.rasterizer.download(&self.splats).await?)
    }

    /// Whether the next step makes its lists anew, so that nothing but the splats, the settings and the step matters to it; or
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
    pub async fn checkpoint(&mut self) -> Result<Checkpoint, Error> {
        if !self.can_checkpoint() {
            let Record { settings, step, .. } = &self.record;
            let next = (step + 1..).find(|&next| settings.bins_afresh_after(next)).unwrap_or(settings.iterations());
            return Err(Error::BetweenCheckpoints { step: *step, next });
        }
        self.settle().await?;
        Ok(Checkpoint { state: self.rasterizer.save(&self.splats).await?, metadata: self.record.to_metadata()? })
    }

    /// Steps done.
    pub fn step(&self) -> u32 {
        self.record.step
    }

    /// Whether all steps are done.
    pub fn is_finished(&self) -> bool {
        self.record.step >= self.record.settings.iterations()
    }

    /// Gaussians now.
    pub fn count(&self) -> u32 {
        self.rasterizer.len(&self.splats) as u32
    }

    /// The settings of this run.
    pub fn settings(&self) -> &S::Settings {
        &self.record.settings
    }

    /// The backend's name and what it runs on.
    pub fn backend(&self) -> String {
        self.rasterizer.describe()
    }

    /// What density control has done so far to the Gaussians that there are, all rounds together.
    pub fn edits(&self) -> &EditCounts {
        &self.record.edits
    }

    /// The effects that the scene is trained with as it is now: those of the last step, or of the first one where none is done.
    pub fn effects(&self) -> Effects {
        self.record.effects()
    }

    /// How often the run has begun again, and why; see [`Recovery`](crate::Recovery).
    pub fn fresh_starts(&self) -> &[FreshStart] {
        &self.record.fresh_starts
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

fn policy<'p, S: Trainable>(
    foreign: &'p Option<ForeignPolicy<S>>,
    settings: &'p S::Settings,
) -> &'p dyn DensityPolicy<S> {
    match foreign {
        Some(policy) => policy.as_ref(),
        None => settings.policy(),
    }
}

/// The random numbers of the initialiser (step 0) or of the round after a step (counted from 1).
pub(crate) fn random(seed: u32, step: u32) -> Rng {
    Rng::seed_from_u64(u64::from(seed) << 32 | u64::from(step))
}
