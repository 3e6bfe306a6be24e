//! The trial by which [`RefinePoses::Auto`] decides before the first step of a run.
//!
//! Scenes are trained on small images, with the cameras as they are given and without a part of the views.
//! Each view left out is then aligned to one half of its image, which says nothing about the other half. Where
//! the given pose is wrong, the other half matches better after that, and where it is right it does not: the
//! noise of the alignment costs a little.

use gs_core::{Camera, Optimizer, Scene3d};

use super::small::{Small, share_of};
use crate::{
    error::Error,
    start::Start,
    train::{
        beginning::Beginning,
        evaluation::of_half,
        poses::{
            Poses, RefinePoses,
            align::{self, Half},
        },
        settings::TrainSettings,
        trial::ranks::are_above,
    },
    views::Views,
};

/// Share of the pixels of a run's steps that the steps of its trial may have. Images are smaller at first in
/// many runs, small ones cost more for each pixel, and views are aligned besides: this is about 5 % of the time.
const SHARE: f64 = 0.03;

/// Least number of steps of a trial, however short the run is.
const LEAST_STEPS: u32 = 120;

/// Number of steps after which a training shows the scene, and of epochs if these are more.
const ENOUGH_STEPS: u32 = 240;
const ENOUGH_EPOCHS: u32 = 3;

/// Number of views that are left out if there are enough steps, over all trainings.
const ENOUGH_VIEWS: usize = 12;

/// A training leaves out a quarter of the views at most: one in so many.
const LEAST_PARTS: usize = 4;

/// Gain that counts, dB: refinement costs at least that where poses are right.
const LEAST_DB: f64 = 0.1;

/// What a trial found.
#[derive(Debug, Clone, Default)]
pub(super) struct Trial {
    /// Numbers and aligned cameras of the training views that were left out.
    pub(super) aligned: Vec<(usize, Camera)>,
    /// Gains in PSNR of the halves that they were not aligned to, dB.
    gains: Vec<f64>,
}

impl Trial {
    /// Tries the poses of these training views on their small images, before a run with these settings.
    ///
    /// # Errors
    /// Those of the backend, of training, and of reading an image.
    pub(super) async fn run<R: Optimizer<Scene3d>>(
        on: &R,
        views: &Views,
        small: &Small,
        settings: &TrainSettings,
    ) -> Result<Self, Error> {
        let Plan { parts, trainings, steps } = Plan::of(views.train_cameras(), settings.iterations);
        let (mut aligned, mut gains) = (Vec::new(), Vec::new());
        for part in 0..trainings {
            let (test, train): (Vec<_>, Vec<_>) = (0..small.views.len()).partition(|index| index % parts == part);
            let of = |indices: &[usize]| indices.iter().map(|&index| small.views[index].clone()).collect::<Vec<_>>();
            let (views_of_part, settings) = (Views::new(of(&train), of(&test)), small.settings(settings, steps));
            let begun = Beginning::new(views_of_part, Start::Scene(small.scene.clone()), settings)?;
            let mut trainer = begun.trainer(on, Poses::default())?;
            trainer.run(&mut ()).await?;
            let render = trainer.shown();
            for (index, view) in test.into_iter().zip(&trainer.views().test) {
                for (half, other) in [(Half::Left, Half::Right), (Half::Right, Half::Left)] {
                    let found = align::nudged((on, &trainer.splats), view, &render, half).await?;
                    let mut psnr = [None; 2];
                    for (camera, psnr) in [view.camera, found].iter().zip(&mut psnr) {
                        let rendered = on.draw(&trainer.splats, camera, &render).await?.0;
                        let measured =
                            of_half(other, &rendered, &view.image()?, render.background_color(), |half| half)?;
                        *psnr = measured.map(|measured| measured.psnr);
                    }
                    // Halves of a plain background match exactly, and say nothing.
                    if let [Some(before), Some(after)] = psnr {
                        gains.extend(Some(after - before).filter(|gain: &f64| gain.is_finite()));
                    }
                    let given = views.train[index].camera;
                    aligned.push((index, Camera { rotation: found.rotation, translation: found.translation, ..given }));
                }
            }
        }
        Ok(Self { aligned, gains })
    }

    /// Mean of the gains, dB; 0 without any.
    pub(super) fn gain(&self) -> f64 {
        self.gains.iter().sum::<f64>() / self.gains.len().max(1) as f64
    }

    /// Whether views match better by [`LEAST_DB`] once they are aligned: a single alignment that goes astray costs more
    /// than many gain.
    pub(super) fn shows_wrong_poses(&self) -> bool {
        are_above(&self.gains, LEAST_DB)
    }
}

/// The trainings of a trial.
#[derive(Debug, PartialEq, Eq)]
struct Plan {
    /// Each training leaves out one of so many views.
    parts: usize,
    trainings: usize,
    /// Steps of each training.
    steps: u32,
}

impl Plan {
    /// The plan for a run of `iterations` steps with these cameras.
    fn of<'a>(cameras: impl ExactSizeIterator<Item = &'a Camera>, iterations: u32) -> Self {
        let views = cameras.len();
        let parts = (views / ENOUGH_VIEWS).max(LEAST_PARTS).min(views.max(1));
        let most = share_of(SHARE, iterations, cameras).max(LEAST_STEPS);
        let steps = RefinePoses::steps(ENOUGH_EPOCHS, views).max(ENOUGH_STEPS).min(most);
        let needed = ENOUGH_VIEWS.div_ceil(views.div_ceil(parts).max(1)).min(parts);
        // A training needs a view.
        let needed = if views > 1 { needed } else { 0 };
        Self { parts, trainings: needed.min((most / steps) as usize), steps }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trial_is_as_long_as_the_run_allows() {
        let plan = |views: usize, side: u32, iterations: u32| {
            let camera = Camera::looking_forward(side, side, 1.0);
            let Plan { parts, trainings, steps } = Plan::of(vec![camera; views].iter(), iterations);
            (parts, trainings, steps)
        };
        // At 160 px, the pixels of a small image are a quarter, and at 1,000 px 1/260.
        assert_eq!(plan(100, 160, 2_000), (8, 1, 240));
        assert_eq!(plan(100, 160, 20_000), (8, 1, 300));
        assert_eq!(plan(12, 1_000, 2_000), (4, 4, 240));
        assert_eq!(plan(9, 160, 600), (4, 1, LEAST_STEPS));
        assert_eq!(plan(2, 1_000, 2_000).1, 2);
        assert_eq!(plan(1, 1_000, 2_000).1, 0);
    }
}
