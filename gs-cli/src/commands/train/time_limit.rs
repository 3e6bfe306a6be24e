//! `--minutes`: chooses settings that this machine can finish in time, and the end of the training.

use std::time::{Duration, Instant};

use gs_backend::{AnyRasterizer, FutureExt as _};
use gs_core::counted;
use gs_io::dataset::{Dataset, Split};
use gs_train::{
    MetricsLog, TrainPreset, TrainSettings,
    limits::Speed,
    train::{Resolution, Start, Views},
};

use super::{arguments::TrainSettingsArgs, not_begun, settings::with_flags};
use crate::{failure::Failure, terminal::output};

/// Share of the remaining time that the chosen settings may use. The rest is a reserve for what the
/// trial cannot measure, such as other programs on the machine.
const PLANNED: f64 = 0.85;

/// Largest share of the planned time for measuring the held-out views during the training.
const MEASURED: f64 = 0.08;

/// Largest share of the time limit for the trial.
const TRIAL: f64 = 0.08;

/// Seconds for writing the results, not counting measurements.
const WRITING: f64 = 1.0;

/// Time for the results after the training, as a multiple of that for evaluating the held-out views.
/// The results are the quality, the sample of training views, the pictures and the effects.
const AFTERWARDS: usize = 3;

/// The time limit of a training.
pub(super) struct TimeLimit<'a> {
    /// The settings of the flags, which the chosen ones keep.
    flags: &'a TrainSettingsArgs,
    started: Instant,
    minutes: f64,
    /// Seconds reserved for the results after the training.
    afterwards: f64,
}

impl<'a> TimeLimit<'a> {
    pub(super) fn new(started: Instant, minutes: f64, flags: &'a TrainSettingsArgs) -> Self {
        Self { flags, started, minutes, afterwards: 0.0 }
    }

    /// Seconds from the start of the program to the time limit.
    fn seconds(&self) -> f64 {
        60.0 * self.minutes
    }

    /// Chooses settings by a trial and prints them. Also returns the metrics log for them.
    pub(super) fn choose(
        &mut self,
        rasterizer: &AnyRasterizer,
        (dataset, views): (&Dataset, &Views),
        start: &Start,
        usual: &TrainSettings,
    ) -> Result<(TrainSettings, MetricsLog), Failure> {
        let clock = Instant::now();
        let speed = Speed::measure(rasterizer, views.clone(), start.clone(), usual, TRIAL * self.seconds()).block_on();
        let speed = speed.map_err(|error| not_begun(error, &dataset.root))?;
        let trial = clock.elapsed().as_secs_f64();
        let left = PLANNED * (self.seconds() - self.started.elapsed().as_secs_f64());
        let (evaluated, measured) = views.evaluated();
        let times = (MEASURED * left / (speed.view_seconds(usual) * measured as f64)) as usize;
        let times = times.clamp(1, 20);
        let (gaussians, measured) = (self.flags.gaussians, [(times + 1) * measured, AFTERWARDS * evaluated]);
        let cameras = dataset.views_of(Split::Train).map(|view| &view.camera);
        let chosen = TrainPreset::settings_within(left, &speed, dataset.kind, cameras, gaussians, measured);
        let Some(chosen) = chosen else {
            let short = format!("--minutes {}: too short for this data set on this machine", self.minutes);
            return Err(Failure::usage(short).hint("give more minutes, or smaller images with --max-size"));
        };
        self.afterwards = (AFTERWARDS * evaluated) as f64 * speed.evaluation_seconds(&chosen);
        let mut chosen = with_flags(self.flags, chosen)?;
        chosen.render = usual.render;
        chosen.depth_loss = usual.depth_loss;
        let first = match chosen.resolution {
            Resolution::CoarseToFine { from, .. } => format!(", at 1/{from} of the size first"),
            _ => String::new(),
        };
        output::note(format_args!(
            "--minutes {}: after a trial of {trial:.1} s, {} with {}{first}, which should take {:.1} minutes",
            self.minutes,
            counted(chosen.iterations, "step"),
            counted(chosen.gaussians, "Gaussian"),
            (self.started.elapsed().as_secs_f64() + speed.seconds(&chosen, measured)) / 60.0,
        ));
        let log = MetricsLog::for_steps(chosen.iterations).measured_at_most(times as u32, chosen.iterations);
        Ok((chosen, log))
    }

    /// The time at which the training stops, finished or not, so that the results are written in
    /// time.
    pub(super) fn end_of_training(&self) -> Instant {
        self.started + Duration::from_secs_f64((self.seconds() - self.afterwards - WRITING).max(0.0))
    }
}
