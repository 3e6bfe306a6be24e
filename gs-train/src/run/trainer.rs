//! The training loop of every kind of training: steps, rounds of density control, and checkpoints
//! from which a run resumes bit for bit. What differs between kinds of training is their
//! [`TrainingTask`].

mod average;
mod density;
mod fresh_start;

use std::{
    fmt,
    sync::{Arc, LazyLock},
    time::Duration,
};

use gs_core::{Binning, Effects, Optimizer, SavedState, Scene2d, Wait, edit::EditCounts, effects::Statistics};
use gs_density::{DensityPolicy, Rng};
use gs_io::Checkpoint;
use rand::SeedableRng;
use web_time::Instant;

pub(crate) use average::Average;
use fresh_start::Start;

use super::{
    checkpoint::Record,
    clamped::Clamped,
    losses::Losses,
    observer::{Control, Observer, Progress, Quality},
    recovery::{FreshStart, Watch, lr_scale},
    rounds::Rounds,
    suspect::Suspect,
    task::{At, RunSettings, StepContext, Trainable, TrainingTask},
};
use crate::error::Error;

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// All steps are done.
    Finished,
    /// An observer stopped the run, which can be resumed from a checkpoint taken now.
    Stopped,
}

/// A training in progress: a fit of 2D Gaussians to an image, or, as
/// [`Trainer3d`](crate::Trainer3d), the training of a 3D scene from views.
///
/// A run is a function of settings, images and backend. At a step at which a checkpoint is
/// possible, it depends only on the splats' state, the settings and the step: random numbers are
/// drawn from (seed, step) in each round, and lists of which Gaussian touches which pixels are
/// not kept over such a step.
pub struct Trainer<'a, R: Optimizer<S>, S: Trainable = Scene2d> {
    pub(crate) rasterizer: &'a R,
    pub(crate) record: Record<S::Settings>,
    pub(crate) splats: R::Splats,
    pub(crate) task: S::TrainingTask<R>,
    /// Whether the next step makes new lists.
    binning: Binning,
    losses: Losses,
    /// Detection of divergence, and what this run, resumed or not, started with.
    watch: Watch,
    start: Option<Start<S>>,
    /// Policy in place of that of the settings.
    custom: Option<CustomPolicy<S>>,
    clock: fn() -> Duration,
    /// Sum of the scenes of the last steps.
    pub(crate) average: Average,
}

/// A policy of the caller's own, which settings cannot name; see [`Trainer::controlled_by`].
pub type CustomPolicy<S = Scene2d> = Arc<dyn DensityPolicy<S> + Send + Sync>;

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
    /// A run in the state of its record.
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
            custom: None,
            clock: wall,
            average: Average::default(),
        }
    }

    /// Returns this run with a policy of the caller's own in place of that of the settings.
    ///
    /// A checkpoint does not hold the policy: pass it again to a resumed run.
    #[must_use]
    pub fn controlled_by(self, policy: CustomPolicy<S>) -> Self {
        Self { custom: Some(policy), ..self }
    }

    /// Returns this run with another clock for its training time, of which `seconds` have passed so
    /// far. `clock` returns the time since some fixed moment, for example the CPU time of the
    /// process; it must not go back.
    ///
    /// A checkpoint holds the time, but not the clock: pass it again to a resumed run.
    #[must_use]
    pub fn timed_by(mut self, clock: fn() -> Duration, seconds: f64) -> Self {
        self.clock = clock;
        self.record.seconds = seconds;
        self
    }

    fn policy(&self) -> &dyn DensityPolicy<S> {
        policy(&self.custom, &self.record.settings)
    }

    /// Runs until the last step, or until an observer stops the run.
    ///
    /// # Errors
    /// [`Error::Diverged`], those of the backend, and those of an observer.
    pub async fn run(&mut self, observer: &mut dyn Observer) -> Result<Outcome, Error> {
        let (mut stop, mut checkpoint) = (false, false);
        while !self.is_finished() {
            let mut progress = self.step_once().await?;
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
            self.report_losses(observer);
            if checkpoint && ends_here {
                observer.on_checkpoint(&mut self.saved().await?)?;
                checkpoint = false;
            }
            if stop && ends_here && !self.is_finished() {
                return Ok(Outcome::Stopped);
            }
        }
        Ok(Outcome::Finished)
    }

    /// Makes a step of the optimizer, and the round of density control that follows it, if one is
    /// due.
    ///
    /// The step itself may still be under way afterwards. A round, the first and the last step of a
    /// run, and steps after which divergence is checked ([`Recovery`](crate::Recovery)) wait for
    /// all steps.
    ///
    /// # Errors
    /// [`Error::Diverged`] where the loss of this or of an earlier step is not finite,
    /// [`Error::Finished`] after the last step, [`gs_core::Error::State`] where a policy of the
    /// caller's own needs evidence and there are no views, and those of the backend.
    pub async fn step_once(&mut self) -> Result<Progress, Error> {
        let iterations = self.iterations();
        if self.is_finished() {
            return Err(Error::Finished { iterations });
        }
        if self.policy().needs().evidence && !S::TrainingTask::<R>::HAS_VIEWS {
            let message = "the policy needs evidence over several views, which only training in 3D has";
            return Err(gs_core::Error::State(message.to_owned()).into());
        }
        self.check_divergence().await?;
        self.losses.clear_pending();
        let started = (self.clock)();
        self.keep_start().await?;
        self.optimise().await?;
        self.record.step += 1;
        let due = self.rounds().progress(self.record.step, iterations);
        let settled = due.is_some() || self.is_judged() || self.is_finished() || self.losses.last().is_none();
        self.collect_losses(if settled { Wait::All } else { Wait::Arrived }).await?;
        let fresh = self.record.settings.bins_afresh_after(self.record.step);
        self.binning = if fresh { Binning::Fresh } else { Binning::Reuse };
        let mut edits = match due {
            Some(progress) => Some(self.control_density(progress).await?),
            None => None,
        };
        self.add_noise()?;
        self.average().await?;
        if self.is_finished() {
            self.clean_up(&mut edits).await?;
        }
        let fresh_start = self.restart_if_diverged().await?;
        self.count_time(started);
        self.progress(edits, fresh_start)
    }

    /// The current state, for the task.
    pub(crate) fn at(&self) -> At<'_, R, S> {
        At { on: self.rasterizer, splats: &self.splats, settings: &self.record.settings, effects: self.effects() }
    }

    /// State of the run for observers.
    fn progress(&self, edits: Option<EditCounts>, fresh_start: Option<FreshStart>) -> Result<Progress, Error> {
        let loss = self.losses.last().ok_or_else(|| self.missing_losses())?;
        Ok(Progress {
            step: self.record.step,
            iterations: self.iterations(),
            seconds: self.record.seconds,
            count: self.count(),
            loss,
            loss_step: self.losses.arrived(),
            edits,
            fresh_start,
            psnr_estimate: self.task.psnr_estimate(&self.record.settings, loss),
            quality: None,
        })
    }

    /// Rounds of density control; none in a run that has restarted twice.
    fn rounds(&self) -> &Rounds {
        match self.record.fresh_starts.len() {
            0 | 1 => self.record.settings.of_loop().rounds,
            _ => &Rounds::NEVER,
        }
    }

    /// Number of rounds of density control since the start or the last restart, until this progress.
    pub(crate) fn rounds_of_scene(&self, until: f32) -> u32 {
        let Record { step, fresh_starts, .. } = &self.record;
        let since = fresh_starts.last().map_or(0, |start| start.step);
        let counts = |at: &u32| self.rounds().progress(*at, self.iterations()).is_some_and(|now| now <= until);
        (since + 1..=*step).filter(counts).count() as u32
    }

    /// Whether the run has a policy of the caller's own.
    pub(crate) fn has_custom_policy(&self) -> bool {
        self.custom.is_some()
    }

    /// Learning-rate scale.
    fn lr_scale(&self) -> f32 {
        lr_scale(self.record.fresh_starts.len())
    }

    /// Sends one step of the optimizer.
    async fn optimise(&mut self) -> Result<(), Error> {
        let Record { settings, step, .. } = &self.record;
        let needs = self.policy().needs();
        // Statistics that no later round uses are not collected.
        let statistics = match *step < self.rounds().last(self.iterations()) {
            true => needs.statistics,
            false => Statistics::None,
        };
        let effects = Effects { statistics, ..settings.effects_after(*step) };
        let full_depth = needs.full_depth * self.task.extent();
        let context =
            StepContext { step: *step, effects, full_depth, lr_scale: self.lr_scale(), binning: self.binning };
        let at = At { on: self.rasterizer, splats: &self.splats, settings, effects };
        self.task.prepare(at, *step).await?;
        self.task.send(self.rasterizer, &mut self.splats, settings, context).await
    }

    /// Records the losses that have arrived, or waits for all.
    async fn collect_losses(&mut self, wait: Wait) -> Result<(), Error> {
        let (images, watch) = (self.task.images(), &mut self.watch);
        let list = self.losses.list();
        let known = list.len();
        let added = self.rasterizer.losses(&mut self.splats, wait, list).await;
        // Losses that arrived before an error count.
        self.losses.record(known, |step, loss| watch.record(step, loss, images));
        added?;
        self.check_divergence().await?;
        match wait == Wait::All && self.losses.arrived() != self.record.step {
            true => Err(self.missing_losses()),
            false => Ok(()),
        }
    }

    fn missing_losses(&self) -> Error {
        let (arrived, step) = (self.losses.arrived(), self.record.step);
        gs_core::Error::State(format!("the backend has reported the losses of {arrived} steps out of {step}")).into()
    }

    /// Waits for the steps under way, which counts as training time, and records their losses.
    async fn settle(&mut self) -> Result<(), Error> {
        let started = (self.clock)();
        self.collect_losses(Wait::All).await?;
        self.count_time(started);
        Ok(())
    }

    /// Adds the time since a moment of the clock to the training time.
    fn count_time(&mut self, started: Duration) {
        self.record.seconds += (self.clock)().saturating_sub(started).as_secs_f64();
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

    fn report_losses(&mut self, observer: &mut dyn Observer) {
        let (first_step, losses) = self.losses.pending();
        if !losses.is_empty() {
            observer.on_losses(first_step, losses);
            self.losses.clear_pending();
        }
    }

    /// Measures the quality of the current scene by rendering it.
    ///
    /// # Errors
    /// Those of the backend, and of reading an image.
    pub async fn quality(&self) -> Result<Quality, Error> {
        let quality = self.task.quality(self.at()).await?;
        Ok(Quality { clamped: self.clamped().await?, ..quality })
    }

    /// Counts the Gaussians with a scale at one of the optimizer's bounds.
    ///
    /// # Errors
    /// Those of the backend.
    pub(crate) async fn clamped(&self) -> Result<Clamped, Error> {
        Ok(Clamped::of(&self.scene().await?, &self.record.settings))
    }

    /// Downloads the current scene.
    ///
    /// # Errors
    /// Those of the backend.
    pub async fn scene(&self) -> Result<S, Error> {
        Ok(self.rasterizer.download(&self.splats).await?)
    }

    /// Whether a checkpoint is possible: the next step makes new lists, or there is no next step.
    pub fn can_checkpoint(&self) -> bool {
        self.binning == Binning::Fresh || self.is_finished()
    }

    /// Takes a checkpoint, for [`Trainer::resume`]. Waits for the steps under way, as all losses
    /// before a checkpoint must be finite.
    ///
    /// # Errors
    /// [`Error::BetweenCheckpoints`] where [`Trainer::can_checkpoint`] is false,
    /// [`Error::Diverged`], [`Error::Checkpoint`] for settings that cannot be stored, and those of
    /// the backend.
    pub async fn checkpoint(&mut self) -> Result<Checkpoint, Error> {
        let Checkpoint { state, metadata } = self.saved().await?;
        Ok(Checkpoint { state: state.collect(), metadata })
    }

    /// [`Self::checkpoint`] for writing to a file: on backends whose memory is the host's, its state
    /// takes no memory.
    ///
    /// # Errors
    /// Those of [`Self::checkpoint`].
    pub async fn saved(&mut self) -> Result<Checkpoint<SavedState<'_>>, Error> {
        if !self.can_checkpoint() {
            let Record { settings, step, .. } = &self.record;
            let next = (step + 1..).find(|&next| settings.bins_afresh_after(next)).unwrap_or(self.iterations());
            return Err(Error::BetweenCheckpoints { step: *step, next });
        }
        self.settle().await?;
        self.task.settle(self.rasterizer, &mut self.splats).await?;
        let mut metadata = self.record.to_metadata()?;
        metadata.extend(self.task.state()?.into_iter().map(|(key, text)| (key.to_owned(), text)));
        let mut state = self.rasterizer.saved(&self.splats).await?;
        self.average.save(&mut state);
        Ok(Checkpoint { state, metadata })
    }

    /// Steps done.
    pub fn step(&self) -> u32 {
        self.record.step
    }

    /// Steps in all.
    pub fn iterations(&self) -> u32 {
        self.record.settings.of_loop().iterations
    }

    /// Whether all steps are done.
    pub fn is_finished(&self) -> bool {
        self.record.step >= self.iterations()
    }

    /// Number of Gaussians.
    pub fn count(&self) -> u32 {
        self.rasterizer.len(&self.splats) as u32
    }

    /// Settings of the run: [`FitSettings`](crate::FitSettings) or
    /// [`TrainSettings`](crate::TrainSettings).
    pub fn settings(&self) -> &S::Settings {
        &self.record.settings
    }

    /// Name of the backend and what it runs on.
    pub fn backend(&self) -> String {
        self.rasterizer.describe()
    }

    /// Edits of density control since the start or the last restart.
    pub fn edits(&self) -> &EditCounts {
        &self.record.edits
    }

    /// Effects that the scene is trained with: those of the last step, or of the first one before
    /// any step.
    pub fn effects(&self) -> Effects {
        self.record.effects()
    }

    /// Restarts of the run; see [`Recovery`](crate::Recovery).
    pub fn fresh_starts(&self) -> &[FreshStart] {
        &self.record.fresh_starts
    }

    /// The last loss that has arrived, as in [`Progress::loss`]; `None` before the first step of
    /// this run, resumed or not.
    pub fn loss(&self) -> Option<f32> {
        self.losses.last()
    }

    /// The losses that have arrived since the last [`Trainer::step_once`] began, in the order of
    /// their steps, and the first of these steps, counted from 1. Over all steps they are the
    /// losses of all steps, each once.
    pub fn new_losses(&self) -> (u32, &[f32]) {
        self.losses.pending()
    }

    /// Training time so far, s; see [`Progress::seconds`].
    pub fn seconds(&self) -> f64 {
        self.record.seconds
    }
}

/// The time that has passed on the wall, since the first call.
fn wall() -> Duration {
    static FIRST: LazyLock<Instant> = LazyLock::new(Instant::now);
    FIRST.elapsed()
}

fn policy<'p, S: Trainable>(
    custom: &'p Option<CustomPolicy<S>>,
    settings: &'p S::Settings,
) -> &'p dyn DensityPolicy<S> {
    match custom {
        Some(policy) => policy.as_ref(),
        None => settings.policy(),
    }
}

/// Random number generator of the initialiser (step 0) or of the round after a step (counted from
/// 1).
pub(crate) fn random(seed: u32, step: u32) -> Rng {
    Rng::seed_from_u64(u64::from(seed) << 32 | u64::from(step))
}
