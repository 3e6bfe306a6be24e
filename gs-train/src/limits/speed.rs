//! Settings for a time limit: a short trial measures how fast this machine trains on these views,
//! and settings are chosen that it can finish in time.

use std::collections::BTreeMap;

use gs_core::{Camera, Optimizer, Scene, Scene3d, metrics::median};
use gs_io::dataset::DatasetKind;
use web_time::Instant;

use crate::{
    error::Error,
    run::{Recovery, Rounds},
};
use crate::{
    start::Start,
    train::{RefinePoses, TrainPreset, TrainSettings, Trainer3d},
    views::{ImageReading, PosedView, Resolution, Views},
};

/// Steps of a trial: enough for a dozen steps without a round at each of the two resolutions.
const STEPS: u32 = 48;

/// Least number of steps at each resolution of a trial that takes long.
const LEAST_STEPS: u32 = 8;

/// Steps between two rounds of density control in a trial.
const ROUND_EVERY: u32 = 4;

/// Largest number of Gaussians in a trial. Times for more Gaussians are extrapolated.
const MOST_GAUSSIANS: u32 = 200_000;

/// Largest number of training views in a trial, as many as policies look at in a round, and of test
/// views.
const MOST_TRAINING_VIEWS: usize = 10;
const MOST_TEST_VIEWS: usize = 4;

/// Sizes of a run relative to the preset, from the shortest to the longest: a factor for the steps and
/// one for the Gaussians. Sizes between them are used, too.
const SIZES: [[f64; 2]; 9] =
    [[0.03, 0.2], [0.13, 0.3], [0.2, 0.4], [0.4, 0.5], [1.0, 1.0], [1.2, 1.0], [1.7, 1.5], [2.5, 2.0], [3.0, 2.0]];

/// The longest run with few views; shorter ones as in [`SIZES`] up to the preset itself.
const LONGEST_OF_FEW_VIEWS: [f64; 2] = [2.0, 1.0];

/// Halvings of the interval of sizes in the search for one that takes the given time.
const HALVINGS: u32 = 16;

/// Factor of the steps below which a run starts at a quarter of the resolution.
const SHORT: f64 = 0.25;

/// Least number of views with which a run may have more Gaussians than the preset, and more than
/// twice its steps. Fewer views are soon overfitted.
const MANY_VIEWS: usize = 50;

/// Speed of training on one machine with one backend and the views of one data set.
#[derive(Debug, Clone, PartialEq)]
pub struct Speed {
    /// Seconds of a step, by the factor by which the sides of the images are reduced.
    step: BTreeMap<u32, Line>,
    /// Seconds of a round of density control.
    round: Line,
    /// Seconds for reading the image of a view from its file while the run goes on.
    read: f64,
    /// Seconds for rendering a view with `viewed` Gaussians and comparing it with its image.
    view: f64,
    /// Seconds for evaluating a view after the training, likewise.
    evaluation: f64,
    viewed: u32,
    /// Number of Gaussians at the start.
    first: usize,
    /// Number of Gaussians of the scene that the training starts from; 0 without one.
    given: usize,
    /// Number of points that the training starts from.
    points: usize,
    training_views: usize,
    /// Time of a run in which poses are refined, with its trial and what precedes it, relative to one without.
    with_poses: f64,
    /// Number of views whose images are still to be read.
    unread: usize,
}

/// Seconds as a linear function of the number of Gaussians.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Line {
    fixed: f64,
    per_gaussian: f64,
}

impl Line {
    /// The Theil–Sen line: median slope and median intercept, which a few slow steps hardly change.
    /// Without points, both are 0.
    fn through(points: &[(u32, f64)]) -> Self {
        let slopes = points.iter().enumerate().flat_map(|(i, a)| {
            points[..i].iter().filter(|b| b.0 != a.0).map(|b| (a.1 - b.1) / (f64::from(a.0) - f64::from(b.0)))
        });
        let per_gaussian = median(slopes).max(0.0);
        let fixed = median(points.iter().map(|&(count, seconds)| seconds - per_gaussian * f64::from(count)));
        Self { fixed: fixed.max(0.0), per_gaussian }
    }

    fn at(&self, count: f64) -> f64 {
        self.fixed + self.per_gaussian * count
    }
}

impl Speed {
    /// Measures the speed by a trial: at most 48 steps with these settings on a few of the views, first
    /// at half and then at full resolution, with numbers of Gaussians up to 200,000. It ends after about
    /// `most_seconds`, but not before some steps at each resolution. Its scene is discarded.
    ///
    /// # Errors
    /// Those of [`Trainer3d::from_views`] and of training.
    pub async fn measure<R: Optimizer<Scene3d>>(
        on: &R,
        views: Views,
        start: Start,
        settings: &TrainSettings,
        most_seconds: f64,
    ) -> Result<Self, Error> {
        let started = Instant::now();
        let training_views = views.train.len();
        let images = training_views + views.test.len();
        let views = views.cached();
        let start = start.searched(&views.train)?;
        let views =
            Views { train: few(views.train, MOST_TRAINING_VIEWS), test: few(views.test, MOST_TEST_VIEWS), ..views };
        let reading = read_all(&views)?;
        let mut resolution = match settings.resolution {
            Resolution::Full => Resolution::Full,
            Resolution::CoarseToFine { from, .. } => Resolution::CoarseToFine { from, full_after: 0.5 },
        };
        let given = match &start {
            Start::Scene(scene) => scene.len(),
            _ => 0,
        };
        let points = start.points(&settings.init);
        let gaussians = settings.gaussians.min(MOST_GAUSSIANS);
        // Few enough that their number changes during the trial.
        let most = (gaussians as usize / 4).max(1);
        let (start, first) = thinned(start, most, settings);
        let trial = TrainSettings {
            init: settings.init.with(|s| s.random = settings.init.random.min(most as u32)),
            exactly: true,
            iterations: STEPS,
            sh_degree_every: 1,
            rounds: Rounds { every: ROUND_EVERY, from: ROUND_EVERY, until: STEPS - 1 },
            resolution,
            recovery: Recovery::Never,
            lengthen_to: 0,
            // Its first steps would be on smaller images than the settings name.
            refine_poses: RefinePoses::Off,
            ..settings.clone().with_gaussians(gaussians)
        };
        let mut trainer = Trainer3d::from_views(on, views, start, trial).await?;
        let thin = trainer.count();
        let mut steps = BTreeMap::<u32, Vec<(u32, f64)>>::new();
        let mut rounds = Vec::new();
        let (mut view, mut evaluation, mut viewed) = (0.0, 0.0, thin);
        let (mut before, mut count) = (trainer.seconds(), thin);
        let mut at_full = None;
        while !trainer.is_finished() {
            let (step, share) = (trainer.step(), started.elapsed().as_secs_f64() / most_seconds);
            if at_full.is_some_and(|at| step >= at + LEAST_STEPS && share >= 1.0) {
                break;
            }
            if at_full.is_none() && (step == STEPS / 2 || step >= LEAST_STEPS && share >= 0.4) {
                at_full = Some(step);
                resolution = Resolution::Full;
                trainer.record.settings.resolution = resolution;
                // With the Gaussians of half of the schedule. In the second half, at full
                // resolution, their number goes back to the first.
                let clock = Instant::now();
                let views = trainer.measured_views().len();
                trainer.quality().await?;
                (view, viewed) = (clock.elapsed().as_secs_f64() / views.max(1) as f64, count);
                let clock = Instant::now();
                // Aligning takes several times as long as rendering.
                let evaluated = match settings.refine_poses.is_off() {
                    true => trainer.evaluate(&|_, _, _| Ok(())).await?,
                    false => trainer.evaluate_aligned(&|_, _, _| Ok(())).await?,
                };
                let views = evaluated.views.len();
                evaluation = clock.elapsed().as_secs_f64() / views.max(1) as f64;
                trainer.record.settings.gaussians = thin;
            }
            let factor = resolution.factor(step as f32 / STEPS as f32);
            let progress = trainer.step_once().await?;
            let seconds = progress.seconds - before;
            match progress.edits {
                None => steps.entry(factor).or_default().push((count, seconds)),
                Some(_) => rounds.push((count, seconds)),
            }
            (before, count) = (progress.seconds, progress.count);
        }
        let step = steps.into_iter().map(|(factor, points)| (factor, Line::through(&points))).collect();
        let round = Line::through(&rounds);
        // Threads read while others train, and share the cores with them.
        let read = reading.seconds / (reading.read.max(1) * rayon::current_num_threads()) as f64;
        let unread = images.saturating_sub(reading.read);
        let with_poses = match settings.refine_poses {
            RefinePoses::Off => 1.0,
            RefinePoses::On => 1.1,
            RefinePoses::Auto => 1.15,
        };
        Ok(Self {
            step,
            round,
            read,
            view,
            evaluation,
            viewed,
            first,
            given,
            points,
            training_views,
            with_poses,
            unread,
        })
    }

    /// The speed of a training on other views of the same data set: one that starts from a scene of `first` Gaussians,
    /// with `views` views, none of which has been read, of `pixels` times as many pixels as those of the trial.
    #[must_use]
    pub fn with_views(&self, first: usize, views: usize, pixels: f64) -> Self {
        let scaled = |(factor, line): (&u32, &Line)| (*factor, Line { fixed: line.fixed * pixels, ..*line });
        let step = self.step.iter().map(scaled).collect();
        Self { step, first, unread: views, training_views: views, ..self.clone() }
    }

    /// Seconds for rendering and measuring one view during a training, with as many Gaussians as these
    /// settings allow for the points of the trial. This is an upper estimate, which assumes that the
    /// time is proportional to the number of Gaussians.
    pub fn view_seconds(&self, settings: &TrainSettings) -> f64 {
        self.view * self.more(settings)
    }

    /// Seconds for evaluating one view after a training, an upper estimate like
    /// [`Self::view_seconds`].
    pub fn evaluation_seconds(&self, settings: &TrainSettings) -> f64 {
        // Only the rendering takes longer with more Gaussians.
        self.evaluation + self.view * (self.more(settings) - 1.0)
    }

    /// How many times as many Gaussians there may be as when views were measured.
    fn more(&self, settings: &TrainSettings) -> f64 {
        (self.gaussians(settings) / f64::from(self.viewed.max(1))).max(1.0)
    }

    /// Largest number of Gaussians for the points of the trial.
    fn gaussians(&self, settings: &TrainSettings) -> f64 {
        settings.clone().for_points(self.points).gaussians.into()
    }

    /// Estimated seconds of a training with these settings: reading each image once, maps of colours,
    /// steps, rounds, measuring `measured` views during the training, and evaluating `evaluated` views
    /// after it.
    pub fn seconds(&self, settings: &TrainSettings, [measured, evaluated]: [usize; 2]) -> f64 {
        let budget = self.gaussians(settings);
        let first = (self.first as f64).min(budget);
        let last_round = settings.rounds.last(settings.iterations).max(1);
        let count = |step: u32| {
            let left = 1.0 - (f64::from(step) / f64::from(last_round)).min(1.0);
            budget - (budget - first) * left * left
        };
        let step = |step: u32| {
            let factor = settings.resolution.factor(step as f32 / settings.iterations.max(1) as f32);
            // At a divisor that was not measured, a step takes at most as long as at the next
            // smaller one.
            let line = self.step.range(..=factor).next_back().or(self.step.first_key_value());
            line.map_or(0.0, |(_, line)| line.at(count(step)))
        };
        let is_round = |step: &u32| settings.rounds.progress(*step, settings.iterations).is_some();
        let steps: f64 = (0..settings.iterations).map(step).sum();
        let rounds: f64 = (1..=settings.iterations).filter(is_round).map(|step| self.round.at(count(step))).sum();
        let solutions = settings.exposure.solutions(self.training_views as u32, settings.iterations);
        let maps = self.view * (self.training_views * solutions) as f64;
        let measuring = self.view_seconds(settings) * measured as f64;
        let evaluation = self.evaluation_seconds(settings) * evaluated as f64;
        self.with_poses * (steps + rounds) + self.read * self.unread as f64 + maps + measuring + evaluation
    }
}

/// Reads the images of all views, several at the same time, and says what reading has cost.
fn read_all(views: &Views) -> Result<ImageReading, Error> {
    let all = || views.train.iter().chain(&views.test);
    all().for_each(|view| view.source.read_ahead());
    all().try_for_each(|view| view.source.read().map(drop))?;
    Ok(views.reading().unwrap_or_default())
}

/// At most `most` of the views, evenly spread.
fn few(views: Vec<PosedView>, most: usize) -> Vec<PosedView> {
    let every = views.len().div_ceil(most).max(1);
    views.into_iter().step_by(every).collect()
}

/// The start with at most `most` Gaussians, evenly drawn, and the number that it has with these
/// settings.
fn thinned(start: Start, most: usize, settings: &TrainSettings) -> (Start, usize) {
    let budget = settings.gaussians as usize;
    match start {
        Start::Points(points) => {
            let first = points.len();
            let every = points.len().div_ceil(most).max(1);
            (Start::Points(points.into_iter().step_by(every).collect()), first)
        }
        Start::Scene(scene) => {
            let every = scene.len().div_ceil(most).max(1);
            let thin: Scene3d = (0..scene.len()).step_by(every).map(|index| scene.gaussian(index)).collect();
            (Start::Scene(thin), scene.len())
        }
        start => (start, (settings.init.random as usize).min(budget)),
    }
}

impl TrainPreset {
    /// Settings of [`TrainPreset::Standard`] for training with the views of these cameras, from a
    /// data set of this kind, in at most `seconds`, including the views that are measured during the
    /// training and evaluated after it ([`Speed::seconds`]).
    ///
    /// The run is as long as the time allows. With enough time there are up to 3 times the steps and 2 times the Gaussians of `standard` for
    /// these views and points; with fewer than 50 views, up to 2 times the steps and no more
    /// Gaussians. With less time, there are fewer. `gaussians` sets the largest number of Gaussians
    /// instead. Very short runs start at a quarter of the resolution. `None` if even the shortest run
    /// takes longer.
    pub fn settings_within<'a>(
        seconds: f64,
        speed: &Speed,
        kind: DatasetKind,
        cameras: impl IntoIterator<Item = &'a Camera>,
        gaussians: Option<u32>,
        views: [usize; 2],
    ) -> Option<TrainSettings> {
        let cameras: Vec<&Camera> = cameras.into_iter().collect();
        let usual = Self::Standard.settings_for(None, kind, cameras.iter().copied()).for_points(speed.points);
        let sizes: Vec<[f64; 2]> = if cameras.len() < MANY_VIEWS {
            SIZES.into_iter().filter(|size| size[0] <= 1.0).chain([LONGEST_OF_FEW_VIEWS]).collect()
        } else {
            SIZES.to_vec()
        };
        let settings = |[steps, share]: [f64; 2]| {
            let iterations = (f64::from(usual.iterations) * steps) as u32;
            let scaled = (f64::from(usual.gaussians) * share) as u32;
            let gaussians = gaussians.unwrap_or(scaled).max(speed.given as u32);
            let mut settings = Self::Standard.settings_for(Some(iterations), kind, []).with_gaussians(gaussians);
            if steps < SHORT {
                settings.resolution = Resolution::from_coarse(4);
            }
            settings
        };
        let fits = |settings: &TrainSettings| speed.seconds(settings, views) <= seconds;
        let sized = |at: f64| settings(between(&sizes, at));
        let (mut shorter, mut longer) = (0.0, (sizes.len() - 1) as f64);
        if fits(&sized(longer)) {
            return Some(sized(longer));
        }
        for _ in 0..HALVINGS {
            let middle = f64::midpoint(shorter, longer);
            if fits(&sized(middle)) {
                shorter = middle;
            } else {
                longer = middle;
            }
        }
        Some(sized(shorter)).filter(fits)
    }
}

/// The size at a place between the first, at 0, and the last of these sizes.
fn between(sizes: &[[f64; 2]], at: f64) -> [f64; 2] {
    let first = (at as usize).min(sizes.len() - 2);
    let share = at - first as f64;
    [0, 1].map(|i| sizes[first][i] + share * (sizes[first + 1][i] - sizes[first][i]))
}

#[cfg(test)]
mod tests {
    use gs_core::effects::Antialias;

    use super::*;

    const COLMAP: DatasetKind = DatasetKind::Colmap;

    /// Views that are measured, ten each time, and evaluated.
    const MEASURED: [usize; 2] = [40, 10];

    /// Steps of 10 ms and 1 µs a Gaussian at full resolution, a third of that at half.
    fn speed(training_views: usize) -> Speed {
        let line = |share: f64| Line { fixed: 0.01 * share, per_gaussian: 1e-6 * share };
        Speed {
            step: BTreeMap::from([(1, line(1.0)), (2, line(1.0 / 3.0))]),
            round: line(2.0),
            read: 0.05,
            view: 0.05,
            evaluation: 0.1,
            viewed: 100_000,
            first: 10_000,
            given: 0,
            points: 0,
            training_views,
            with_poses: 1.0,
            unread: training_views,
        }
    }

    fn within(seconds: f64, views: usize) -> Option<TrainSettings> {
        let camera = Camera::looking_forward(400, 400, 1.0);
        TrainPreset::settings_within(seconds, &speed(views), COLMAP, &vec![camera; views], None, MEASURED)
    }

    #[test]
    fn a_line_is_not_moved_by_a_few_slow_steps() {
        let mut points: Vec<(u32, f64)> = (1..20).map(|n| (n * 1_000, 0.01 + f64::from(n) * 1e-3)).collect();
        points[3].1 += 5.0;
        points[11].1 += 5.0;
        let line = Line::through(&points);
        assert!((line.at(30_000.0) - 0.04).abs() < 1e-3, "{line:?}");
        assert_eq!(Line::through(&[(7, 0.5)]), Line { fixed: 0.5, per_gaussian: 0.0 });
    }

    #[test]
    fn more_time_buys_more_steps_and_never_takes_longer_than_there_is() {
        let mut before = 0;
        for seconds in [30.0, 60.0, 120.0, 300.0, 900.0, 3_000.0] {
            let settings = within(seconds, 100).unwrap();
            settings.validate().unwrap();
            let planned = speed(100).seconds(&settings, MEASURED);
            assert!(planned <= seconds && (planned > 0.97 * seconds || settings.iterations == 12_000), "{seconds}");
            assert!(settings.iterations >= before, "{seconds} s: {} steps", settings.iterations);
            before = settings.iterations;
            // Refined poses take their share.
            let with_poses = Speed { with_poses: 1.15, ..speed(100) };
            let camera = vec![Camera::looking_forward(400, 400, 1.0); 100];
            let fewer = TrainPreset::settings_within(seconds, &with_poses, COLMAP, &camera, None, MEASURED).unwrap();
            assert!(fewer.iterations < settings.iterations || before == 12_000, "{seconds}: {}", fewer.iterations);
            assert!(with_poses.seconds(&fewer, MEASURED) <= seconds, "{seconds}");
        }
        assert_eq!(before, 12_000);
        assert!(within(2.0, 100).is_none());
    }

    #[test]
    fn few_views_get_twice_the_steps_of_the_preset_at_most() {
        let settings = within(1e6, 12).unwrap();
        let camera = Camera::looking_forward(400, 400, 1.0);
        let usual = TrainPreset::Standard.settings_for(Some(4_000), COLMAP, &vec![camera; 12]);
        assert_eq!(settings, usual.for_points(0));
        // Many points raise the number as they do without a time limit.
        let from_points = Speed { points: 7_000, ..speed(12) };
        let settings =
            TrainPreset::settings_within(1e6, &from_points, COLMAP, &vec![camera; 12], None, MEASURED).unwrap();
        assert_eq!(settings.gaussians, 35_000);
    }

    #[test]
    fn rendered_images_have_their_antialiasing_within_a_time_limit_too() {
        let camera = Camera::looking_forward(400, 400, 1.0);
        let settings =
            TrainPreset::settings_within(60.0, &speed(100), DatasetKind::Blender, &vec![camera; 100], None, MEASURED);
        let render = settings.unwrap().render;
        assert_eq!((render.effects.antialias, render.background), (Antialias::Mip, [1.0; 3]));
    }

    #[test]
    fn a_given_number_of_gaussians_stays() {
        let camera = Camera::looking_forward(400, 400, 1.0);
        let settings =
            TrainPreset::settings_within(60.0, &speed(100), COLMAP, &vec![camera; 100], Some(77_000), MEASURED)
                .unwrap();
        assert_eq!(settings.gaussians, 77_000);
    }
}
