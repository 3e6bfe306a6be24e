//! `--minutes`: chooses settings that this machine can finish in time, and the end of the training.

use std::{
    cell::RefCell,
    time::{Duration, Instant},
};

use gs_backend::{AnyRasterizer, FutureExt as _};
use gs_core::{Scene3d, counted};
use gs_io::dataset::{Dataset, Split};
use gs_train::{
    MetricsLog, TrainPreset, TrainSettings, Trainer3d,
    limits::Speed,
    train::{Resolution, Start, Views},
};

use super::{arguments::TrainSettingsArgs, not_begun, settings::with_flags};
use crate::{failure::Failure, terminal::output, training::Pauses};

/// Share of the remaining time that the chosen settings may use.
const PLANNED: f64 = 0.95;

/// Shares of the steps after which their number is changed to what there is time for. The first is
/// after the last round of density control, so that Gaussians and resolution do not change any more.
const ADJUSTED_AT: [f64; 2] = [0.7, 0.87];

/// Share of the steps to which a run does not go back when it becomes longer.
const LEAST_SHARE: f64 = 0.5;

/// Share of the time left for steps that they may use.
const USED: f64 = 0.97;

/// Largest share of the planned time for measuring the held-out views during the training.
const MEASURED: f64 = 0.08;

/// Largest share of the time limit for the trial.
const TRIAL: f64 = 0.08;

/// The most training views of which the quality is measured after the training.
const MOST_SAMPLED: usize = 32;

/// Seconds for writing the results, not counting measurements.
const WRITING: f64 = 1.0;

/// The time limit of a training.
pub(super) struct TimeLimit<'a> {
    /// The settings of the flags, which the chosen ones keep.
    flags: &'a TrainSettingsArgs,
    started: Instant,
    minutes: f64,
    /// What the trial has found; `None` before it, and in a resumed run.
    planned: Option<Planned>,
    /// When the run paused, and after which steps.
    paused: RefCell<Vec<(Instant, u32)>>,
}

/// What a trial has found.
struct Planned {
    speed: Speed,
    /// The chosen settings, with as many Gaussians as are expected at the end.
    settings: RefCell<TrainSettings>,
    /// The most steps to which the run may grow.
    most_steps: u32,
    /// The number of views that are evaluated after the training.
    evaluated: usize,
}

impl Planned {
    /// Seconds for the results after the training.
    fn results(&self) -> f64 {
        let settings = self.settings.borrow();
        self.evaluated as f64 * self.speed.evaluation_seconds(&settings)
            + self.evaluated.min(MOST_SAMPLED) as f64 * self.speed.view_seconds(&settings)
            + WRITING
    }
}

impl<'a> TimeLimit<'a> {
    pub(super) fn new(started: Instant, minutes: f64, flags: &'a TrainSettingsArgs) -> Self {
        Self { flags, started, minutes, planned: None, paused: RefCell::default() }
    }

    /// Seconds from the start of the program to the time limit.
    fn seconds(&self) -> f64 {
        60.0 * self.minutes
    }

    /// Chooses settings by a trial and prints them. Also returns the metrics log for them.
    pub(super) fn choose(
        &mut self,
        rasterizer: &AnyRasterizer,
        (dataset, of): (&Dataset, &Views),
        start: &Start,
        usual: &TrainSettings,
    ) -> Result<(TrainSettings, MetricsLog), Failure> {
        let clock = Instant::now();
        let speed = Speed::measure(rasterizer, of.clone(), start.clone(), usual, TRIAL * self.seconds()).block_on();
        let speed = speed.map_err(|error| not_begun(error, &dataset.root))?;
        let trial = clock.elapsed().as_secs_f64();
        let left = PLANNED * (self.seconds() - self.started.elapsed().as_secs_f64());
        let (evaluated, measured) = of.evaluated();
        let times = (MEASURED * left / (speed.view_seconds(usual) * measured as f64)) as usize;
        let times = times.clamp(1, 20);
        // The quality over training views is measured after the training, too.
        let views = [times * measured + evaluated.min(MOST_SAMPLED), evaluated];
        let gaussians = self.flags.gaussians;
        let cameras = || dataset.views_of(Split::Train).map(|view| &view.camera);
        let within = |seconds| TrainPreset::settings_within(seconds, &speed, dataset.kind, cameras(), gaussians, views);
        let Some(chosen) = within(left - WRITING) else {
            let short = format!("--minutes {}: too short for this data set on this machine", self.minutes);
            return Err(Failure::usage(short).hint("give more minutes, or smaller images with --max-size"));
        };
        let most_steps = within(f64::INFINITY).map_or(chosen.iterations, |longest| longest.iterations);
        let mut chosen = with_flags(self.flags, chosen)?;
        chosen.render = usual.render;
        let first = match chosen.resolution {
            Resolution::CoarseToFine { from, .. } => format!(", at 1/{from} of the size first"),
            _ => String::new(),
        };
        output::note(format_args!(
            "--minutes {}: after a trial of {trial:.1} s, {} with {}{first}, which should take {:.1} minutes",
            self.minutes,
            counted(chosen.iterations, "step"),
            counted(chosen.gaussians, "Gaussian"),
            (self.started.elapsed().as_secs_f64() + speed.seconds(&chosen, views) + WRITING) / 60.0,
        ));
        let log = MetricsLog::for_steps(chosen.iterations).measured_at_most(times as u32, chosen.iterations);
        self.planned = Some(Planned { speed, settings: chosen.clone().into(), most_steps, evaluated });
        Ok((chosen, log))
    }
}

impl Pauses<Scene3d> for TimeLimit<'_> {
    fn next(&self) -> u32 {
        let Some(planned) = &self.planned else { return u32::MAX };
        let settings = planned.settings.borrow();
        let last_round = settings.rounds.last(settings.iterations);
        let after = |share: f64| ((f64::from(settings.iterations) * share) as u32).max(last_round + 1);
        match self.paused.borrow().len() {
            0 => last_round,
            paused => ADJUSTED_AT.get(paused - 1).map_or(u32::MAX, |share| after(*share)),
        }
    }

    fn end(&self) -> Option<Instant> {
        let results = self.planned.as_ref().map_or(WRITING, Planned::results);
        Some(self.started + Duration::from_secs_f64((self.seconds() - results).max(0.0)))
    }

    /// Changes the number of steps to what there is time for.
    fn pause(&self, trainer: &mut Trainer3d<'_, AnyRasterizer>) -> Result<(), Failure> {
        let (now, step) = (Instant::now(), trainer.step());
        let mut paused = self.paused.borrow_mut();
        if let (Some(planned), Some((since, first))) = (&self.planned, paused.first().filter(|pause| step > pause.1)) {
            let seconds = (now - *since).as_secs_f64() / f64::from(step - first);
            planned.settings.replace_with(|settings| settings.clone().with_gaussians(trainer.count()));
            let left = self.end().map_or(0.0, |end| end.saturating_duration_since(now).as_secs_f64());
            let steps = step.saturating_add((USED * left / seconds) as u32);
            // Not so many that what began after a share of the steps, such as full resolution, is undone.
            let most = (f64::from(step) / LEAST_SHARE) as u32;
            trainer.end_after(steps.min(planned.most_steps).min(most));
        }
        paused.push((now, step));
        Ok(())
    }
}
