//! A run's first scene and views, small enough that a training with them takes a few percent of the run's time.

use std::sync::Arc;

use gs_core::{Camera, Optimizer, Scene3d};
use gs_density::Policy;
use rayon::prelude::*;

use crate::{
    error::Error,
    start::Start,
    train::{
        beginning::Beginning,
        poses::{Motion, Poses, RefinePoses, align},
        presets::TrainPreset,
        settings::TrainSettings,
        trial::thinned::thinned,
    },
    views::{PosedView, Resolution, Views, reduced, reduced_camera},
};

/// Number of pixels of an image: so few that a wrong pose is an error of a pixel or less.
const PIXELS: u64 = 4_000;

/// Most Gaussians: about one for two pixels of an image. More would fit the images of few views with wrong poses,
/// too, and then no gradient corrects these.
const MOST_GAUSSIANS: usize = 2_000;

/// Factor of the learning rate of colours, because these trainings are short.
const FASTER: f32 = 8.0;

/// Most pixels of the training in which cameras move, relative to those of the run, and bounds of its number of
/// epochs. It has no more steps than the run, whatever a step costs.
const SHARE: f64 = 0.06;
const EPOCHS: [u32; 2] = [15, 80];

/// Small views, and a scene for them.
#[derive(Debug)]
pub(super) struct Small {
    pub(super) views: Vec<PosedView>,
    pub(super) scene: Scene3d,
}

impl Small {
    /// Of training views and the first scene of a run.
    ///
    /// # Errors
    /// Those of reading an image.
    pub(super) fn of(views: &[PosedView], scene: &Scene3d) -> Result<Self, Error> {
        let views: Vec<_> = views.par_iter().map(small).collect();
        // The first error, whichever thread was faster.
        let views = views.into_iter().collect::<Result<_, _>>()?;
        Ok(Self { views, scene: thinned(scene, MOST_GAUSSIANS, 0).0 })
    }

    /// Settings for a training of this many steps. They are the same for all presets, except for how pixels look.
    pub(super) fn settings(&self, of_run: &TrainSettings, steps: u32) -> TrainSettings {
        TrainPreset::Quick.settings(Some(steps)).with_gaussians(MOST_GAUSSIANS as u32).with(|s| {
            (s.seed, s.extent) = (of_run.seed, of_run.extent);
            s.render = of_run.render;
            s.render.effects.sh_degree = 0;
            s.policy = Policy::None;
            s.resolution = Resolution::Full;
            s.adam.color.learning_rate *= FASTER;
        })
    }

    /// The cameras after a training in which they move, before a run with these settings. Their common motion is
    /// the one that fits the scene best.
    ///
    /// # Errors
    /// Those of the backend, and of training.
    pub(super) async fn moved<R: Optimizer<Scene3d>>(
        self,
        on: &R,
        cameras: impl ExactSizeIterator<Item = &Camera>,
        of_run: &TrainSettings,
    ) -> Result<Vec<Camera>, Error> {
        let [least, most] = EPOCHS.map(|epochs| RefinePoses::steps(epochs, cameras.len()));
        let steps = share_of(SHARE, of_run.iterations, cameras).clamp(least, most).min(of_run.iterations);
        let settings = self.settings(of_run, steps).with(|s| s.resolution = Resolution::from_coarse(2));
        let poses = Poses::moving(&self.views, &self.scene, Motion::BEFORE_RUN);
        let views = Views::new(self.views, Vec::new());
        let mut trainer = Beginning::new(views, Start::Scene(self.scene), settings)?.trainer(on, poses)?;
        trainer.run(&mut ()).await?;
        Ok(trainer.views().train_cameras().copied().collect())
    }
}

/// Number of steps with small images whose pixels are this share of those of a run.
pub(super) fn share_of<'a>(share: f64, iterations: u32, cameras: impl Iterator<Item = &'a Camera>) -> u32 {
    let pixels = |camera: &Camera| f64::from(camera.width) * f64::from(camera.height);
    let [all, small] = cameras.fold([0.0; 2], |[all, small], camera| {
        [all + pixels(camera), small + pixels(&reduced_camera(camera, factor(camera)))]
    });
    (share * f64::from(iterations) * all / small) as u32
}

/// The divisor of a view's sides.
fn factor(camera: &Camera) -> u32 {
    align::divisor(camera, PIXELS)
}

fn small(view: &PosedView) -> Result<PosedView, Error> {
    let factor = factor(&view.camera);
    let source = Arc::new(reduced(&view.image()?, factor)?);
    Ok(PosedView { name: view.name.clone(), camera: reduced_camera(&view.camera, factor), source })
}
