//! The trial by which a run decides its numbers of steps and Gaussians before its first step.
//!
//! A part of the run is done first on small images and without some of its views, which are measured before each round
//! of density control. Where they still gain at its end, a longer run will gain, too. Where they lose while the number
//! of Gaussians grows, more Gaussians harm; where they gain without that, the longer run may have twice as many. The
//! scene of the trial is discarded, and the run uses all of its views.

pub(super) mod ranks;
pub(super) mod report;
pub(super) mod thinned;

use gs_core::{Optimizer, Scene3d, constants::MAX_GAUSSIANS, metrics::mean};
use web_time::Instant;

use self::{
    ranks::are_above,
    report::{Trial, TrialReport},
    thinned::thinned,
};
use super::{
    beginning::Beginning,
    evaluation::measure,
    exposure::Exposure,
    poses::{Poses, RefinePoses},
    settings::TrainSettings,
    trainer::Trainer3d,
};
use crate::{
    error::Error,
    run::Recovery,
    start::Start,
    views::{PosedView, Resolution, Views, images, possible, reduced_camera},
};

/// Share of the run's steps that a trial makes: enough for half of the growth.
const SHARE: f32 = 0.4;

/// Divisor of the images' sides.
const FACTOR: u32 = 4;

/// Highest SH degree, and about the most Gaussians at the start: on small images, most of the time goes into their
/// parameters.
const SH_DEGREE: u8 = 1;
const MOST_AT_START: usize = 16_000;

/// One of so many views is left out, at most [`MOST_LEFT_OUT`].
const ONE_OF: usize = 6;
const MOST_LEFT_OUT: usize = 8;

/// Least number of training views for a trial.
const LEAST_VIEWS: usize = 5;

/// Least number of measurements for a decision.
const LEAST_MEASURED: usize = 6;

/// Least gain in the last third of the measurements with which a run is lengthened, dB. Three captures on which twice
/// the steps gain have 0.22 to 1.17 over three seeds, three others at most 0.12.
const LEAST_GAIN_DB: f64 = 0.2;

/// How many times the Gaussians a lengthened run may have. On three captures that gain by more steps, twice as many gain
/// another 0.25 to 0.43 dB; three times as many gain no more.
const MORE: u32 = 2;

/// Most steps between two rounds of density control of a run that is lengthened, unless there were more before.
const MOST_BETWEEN_ROUNDS: u32 = 100;

/// Number of measurements at the end whose mean shows whether growth has harmed, and by how much views are then below
/// the best measurement, dB.
const RECENT: usize = 3;
const HARM_DB: f64 = 0.5;

/// Least number of views left out that can show that growth harms: one or two lose by chance.
const LEAST_HARMED: usize = 5;

/// The scene on the views left out, before a round of density control.
#[derive(Debug, Clone)]
struct Measured {
    gaussians: u32,
    /// PSNR of each view, dB.
    psnr: Vec<f64>,
}

impl TrainSettings {
    /// Whether a run with these settings and so many training views begins with a trial ([`Self::lengthen_to`]).
    pub fn has_trial(&self, views: usize) -> bool {
        self.lengthen_to > self.iterations && views >= LEAST_VIEWS && self.fixed == 0
    }
}

/// The trial of a run that begins with this scene, whose settings are then those that it decided; `None` for a run
/// without a trial, or where it was too short to decide anything.
///
/// # Errors
/// Those of the backend, of training, and of reading an image.
pub(super) async fn trial<R: Optimizer<Scene3d>>(
    on: &R,
    views: &Views,
    scene: &Scene3d,
    settings: &mut TrainSettings,
) -> Result<Option<Trial>, Error> {
    let (started, given) = (Instant::now(), settings.clone());
    let decided = match settings.has_trial(views.train.len()) {
        true => measured(on, views, scene, settings).await,
        false => Ok(Vec::new()),
    };
    let decided = match decided {
        // The views that are left out may be all that see something.
        Err(Error::NothingInView { .. } | Error::Diverged { .. }) => Vec::new(),
        decided => decided?,
    };
    let (lengthen_to, decides) = (settings.lengthen_to, settings.decide_gaussians && !settings.exactly);
    (settings.lengthen_to, settings.decide_gaussians) = (0, false);
    let Some(gain_db) = gain(&decided) else { return Ok(None) };
    let more = settings.gaussians.saturating_mul(MORE).min(MAX_GAUSSIANS);
    let gaussians = best_number(&decided).or((gain_db >= LEAST_GAIN_DB).then_some(more)).filter(|_| decides);
    let (steps, left_out) = (steps(settings), decided[0].psnr.len());
    if gain_db >= LEAST_GAIN_DB {
        let every = settings.rounds.every;
        *settings = settings.clone().lasting(lengthen_to);
        settings.rounds.every = settings.rounds.every.min(every.max(MOST_BETWEEN_ROUNDS));
    }
    settings.gaussians = gaussians.unwrap_or(settings.gaussians);
    let (seconds, iterations) = (started.elapsed().as_secs_f64(), settings.iterations);
    Ok(Some(Trial { report: TrialReport { steps, left_out, seconds, gain_db, iterations, gaussians }, given }))
}

/// Number of steps of the trial for a run with these settings.
fn steps(settings: &TrainSettings) -> u32 {
    (SHARE * settings.iterations as f32) as u32
}

/// The measurements of a trial.
async fn measured<R: Optimizer<Scene3d>>(
    on: &R,
    views: &Views,
    scene: &Scene3d,
    settings: &TrainSettings,
) -> Result<Vec<Measured>, Error> {
    let count = views.train.len();
    let left_out = (count / ONE_OF).clamp(1, MOST_LEFT_OUT);
    let is_left_out = |index: usize| (0..left_out).any(|number| index == (2 * number + 1) * count / (2 * left_out));
    let (test, train): (Vec<usize>, Vec<usize>) = (0..count).partition(|&index| is_left_out(index));
    let of = |indices: Vec<usize>| indices.into_iter().map(|index| views.train[index].clone()).collect();
    let steps = steps(settings);
    let (scene, every) = thinned(scene, MOST_AT_START, SH_DEGREE);
    let every = every as u32;
    let trial = TrainSettings {
        // As many as the thinned scene at least, which is rounded up, too.
        gaussians: settings.gaussians.div_ceil(every),
        // The trial ends before this schedule is at the next size.
        resolution: Resolution::CoarseToFine { from: FACTOR, full_after: 1.0 },
        exposure: Exposure::Off,
        refine_poses: RefinePoses::Off,
        recovery: Recovery::Never,
        lengthen_to: 0,
        render: settings.render.with(|s| s.effects.sh_degree = s.effects.sh_degree.min(SH_DEGREE)),
        ..settings.clone()
    };
    let limited = Views { keep_bytes: views.keep_bytes, ..Views::new(of(train), of(test)) };
    let beginning = Beginning::new(limited, Start::Scene(scene), trial)?;
    let mut trainer = beginning.trainer(on, Poses::default())?;
    let mut measured = Vec::new();
    while trainer.step() < steps {
        let next = trainer.step() + 1;
        if settings.rounds.progress(next, settings.iterations).is_some() {
            let (gaussians, psnr) = (every * trainer.count(), of_test_views(&trainer).await?);
            if !psnr.is_empty() {
                measured.push(Measured { gaussians, psnr });
            }
        }
        trainer.step_once().await?;
    }
    Ok(measured)
}

/// PSNR of the small images of the test views in which some pixel counts, dB.
async fn of_test_views<R: Optimizer<Scene3d>>(trainer: &Trainer3d<'_, R>) -> Result<Vec<f64>, Error> {
    let render = trainer.shown();
    let mut psnr = Vec::new();
    for view in &trainer.views().test {
        let PosedView { camera, .. } = view;
        let factor = possible(camera, FACTOR);
        let rendered = trainer.render_view(&reduced_camera(camera, factor)).await?;
        let posed = images::training_image(view, factor, None)?;
        if let Some(pair) = measure(&rendered, posed, render.background_color())? {
            psnr.push(pair.l1_and_psnr()?.1);
        }
    }
    Ok(psnr)
}

/// How much the best measurement of the last third is above the best one before, dB; `None` without enough of them.
fn gain(measured: &[Measured]) -> Option<f64> {
    let (before, last) = measured.split_at(measured.len() - measured.len() / 3);
    let best = |part: &[Measured]| part.iter().map(|one| mean(&one.psnr)).fold(f64::MIN, f64::max);
    (measured.len() >= LEAST_MEASURED).then(|| best(last) - best(before))
}

/// The number of Gaussians with the best measurement, if views have clearly lost since, with more of them.
fn best_number(measured: &[Measured]) -> Option<u32> {
    let (before, recent) = measured.split_last_chunk::<RECENT>()?;
    let best = before.iter().max_by(|a, b| mean(&a.psnr).total_cmp(&mean(&b.psnr)))?;
    let lost = (0..best.psnr.len()).map(|view| best.psnr[view] - mean(recent.iter().map(|one| one.psnr[view])));
    let lost: Vec<f64> = lost.collect();
    let harms = lost.len() >= LEAST_HARMED && mean(&lost) >= HARM_DB && are_above(&lost, HARM_DB);
    (harms && recent[0].gaussians > best.gaussians).then_some(best.gaussians)
}

#[cfg(test)]
mod tests {
    use std::slice::from_ref;

    use super::*;

    fn measured(rounds: &[(u32, &[f64])]) -> Vec<Measured> {
        rounds.iter().map(|&(gaussians, psnr)| Measured { gaussians, psnr: psnr.to_vec() }).collect()
    }

    #[test]
    fn only_a_gain_at_the_end_lengthens_a_run() {
        let of = |psnr: &[f64]| gain(&measured(&psnr.iter().map(|psnr| (9, from_ref(psnr))).collect::<Vec<_>>()));
        assert_eq!(of(&[20.0, 22.0, 24.0, 25.0, 26.0, 25.5]), Some(1.0));
        assert_eq!(of(&[20.0, 24.0, 25.0, 25.0, 24.5, 24.0]), Some(-0.5));
        assert_eq!(of(&[20.0, 22.0, 24.0, 25.0, 26.0]), None, "too few measurements");
        assert_eq!(of(&[]), None);
    }

    #[test]
    fn growth_is_limited_to_the_best_number_only_where_most_views_have_lost() {
        let (good, worse) = ([24.0; 5], [22.5; 5]);
        let rounds = |last: [f64; 5]| {
            let rounds = [(100, &[20.0; 5]), (110, &good), (121, &last), (133, &last), (146, &last)];
            best_number(&measured(&rounds.map(|(gaussians, psnr)| (gaussians, psnr.as_slice()))))
        };
        assert_eq!(rounds(worse), Some(110));
        assert_eq!(rounds([23.8; 5]), None, "a small loss");
        assert_eq!(rounds([24.0, 24.1, 24.2, 24.0, 12.0]), None, "one view that is far off");
        let few = [(100, &[24.0; 2]), (110, &[20.0; 2]), (121, &[20.0; 2]), (133, &[20.0; 2])];
        let few = measured(&few.map(|(gaussians, psnr)| (gaussians, psnr.as_slice())));
        assert_eq!(best_number(&few), None, "two views lose by chance");
        let same = measured(&[(100, &good), (100, &worse), (100, &worse), (100, &worse)]);
        assert_eq!(best_number(&same), None, "there were no more Gaussians");
        assert_eq!(best_number(&[]), None);
    }
}
