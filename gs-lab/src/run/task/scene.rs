//! Runs on scenes: trainings of 3D Gaussians from views.

use std::{
    collections::BTreeMap,
    sync::{Mutex, PoisonError},
};

use gs_backend::FutureExt as _;
use gs_core::{
    Camera, Error as CoreError, Gaussian3d, Image, Optimizer, Parameterization, RenderSettings, Scene3d, math::sh,
};
use gs_io::{Checkpoint, dataset::Dataset};
use gs_train::{
    Error as TrainError, Recovery, TrainSettings, Trainer, Trainer3d,
    train::{Evaluation, PoseMatched, ViewQuality, Views},
};

use super::{Finished, StudyTask, image::wrong_kind};
use crate::{
    run::record::ViewResult,
    study::{Arm, Clock, Column, Measure, StudyTarget, digest},
};

/// Held-out views of each scene that reports show, evenly spread.
pub(crate) const PICTURED_VIEWS: usize = 3;

impl StudyTask for Scene3d {
    fn without_recovery(settings: &TrainSettings) -> TrainSettings {
        settings.clone().with(|s| s.recovery = Recovery::Never)
    }

    fn begin<'r, R: Optimizer<Self>>(
        rasterizer: &'r R,
        target: &StudyTarget,
        arm: &Arm,
        settings: TrainSettings,
        clock: Clock,
    ) -> Result<Trainer<'r, R, Self>, TrainError> {
        let Some(dataset) = target.dataset() else { return Err(wrong_kind(target)) };
        let views = views(target, dataset, arm, settings.seed)?;
        let start = arm.start(dataset, &settings);
        let start = match arm.pose_error {
            Some(_) => start.of(dataset)?.searched(&views.train)?,
            None => target.start(start, dataset, &views.train)?,
        };
        clock.begin(|| Trainer3d::from_views(rasterizer, views, start, settings).block_on())
    }

    fn resume<'r, R: Optimizer<Self>>(
        rasterizer: &'r R,
        target: &StudyTarget,
        (arm, seed): (&Arm, u32),
        checkpoint: Checkpoint,
    ) -> Result<Trainer<'r, R, Self>, TrainError> {
        let Some(dataset) = target.dataset() else { return Err(wrong_kind(target)) };
        Trainer3d::resume_views(rasterizer, views(target, dataset, arm, seed)?, checkpoint)
    }

    fn measure<R: Optimizer<Self>>(
        trainer: &Trainer<'_, R, Self>,
        align_poses: bool,
        finished: &mut Finished,
    ) -> Result<Vec<Image>, TrainError> {
        let names: Vec<String> = trainer.evaluation_views().iter().map(|view| view.name.clone()).collect();
        let shown = names.len().min(PICTURED_VIEWS);
        let shown: Vec<usize> = (0..shown).map(|index| index * names.len() / shown).collect();
        let rendered = Mutex::new(BTreeMap::new());
        let look = |number: usize, _: &_, image: &Image| {
            if shown.contains(&number) {
                rendered.lock().unwrap_or_else(PoisonError::into_inner).insert(number, image.clone());
            }
            Ok(())
        };
        let evaluation = match align_poses {
            true => right_halves(trainer.evaluate_aligned(&look).block_on()?)?,
            false => trainer.evaluate(&look).block_on()?,
        };
        let rendered = rendered.into_inner().unwrap_or_else(PoisonError::into_inner);
        let mut rendered: Vec<(&String, Image)> =
            rendered.into_iter().map(|(number, image)| (&names[number], image)).collect();
        rendered.retain(|(name, _)| evaluation.views.iter().any(|view| view.name == **name));
        let view = |view: ViewQuality| ViewResult {
            is_shown: rendered.iter().any(|(name, _)| **name == view.name),
            name: view.name,
            psnr: view.psnr,
            ssim: view.ssim,
            ms_ssim: view.ms_ssim,
            l1: view.l1,
            curve: Vec::new(),
        };
        let Evaluation { psnr, ssim, ms_ssim, l1, culled, views, .. } = evaluation;
        let views = views.into_iter().map(view).collect();
        *finished = Finished { psnr, ssim, ms_ssim, l1, culled, views, ..finished.clone() };
        Ok(rendered.into_iter().map(|(_, image)| image).collect())
    }

    fn further<R: Optimizer<Self>>(
        _: Measure,
        _: &R,
        _: &StudyTarget,
        _: &TrainSettings,
        _: &Self,
    ) -> Result<Vec<(Column, f64)>, TrainError> {
        Ok(Vec::new())
    }

    fn draw_one<R: Optimizer<Self>>(rasterizer: &R, render: &RenderSettings) -> Result<(), CoreError> {
        let gaussian = Gaussian3d {
            mean: [0.0, 0.0, 1.0].into(),
            log_scale: [-3.0; 3].into(),
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit: 0.0,
            sh: vec![[0.5; 3].into(); sh::coefficients(render.effects.sh_degree)],
        };
        let mut scene = Self { sh_degree: render.effects.sh_degree, ..Self::default() };
        gs_core::Scene::push(&mut scene, gaussian);
        let splats = rasterizer.upload(&scene, Parameterization::ScaleRotation)?;
        rasterizer.forward(&splats, &Camera::looking_forward(1, 1, 1.0), render).block_on().map(drop)
    }

    fn digest(&self) -> String {
        digest::of_scene_3d(self)
    }

    fn bytes(&self) -> u64 {
        // Mean, scale, rotation, opacity, and SH.
        4 * (11 * self.means.len() + 3 * self.sh.len()) as u64
    }
}

/// The evaluation of the right halves of the views at aligned poses, in place of that of whole views.
fn right_halves(mut evaluation: Evaluation) -> Result<Evaluation, TrainError> {
    let Some(PoseMatched { psnr, ssim, l1, .. }) = evaluation.pose_matched else {
        return Err(TrainError::NothingCounts { views: evaluation.views.len() });
    };
    (evaluation.psnr, evaluation.ssim, evaluation.l1, evaluation.ms_ssim) = (psnr, ssim, l1, None);
    evaluation.views.retain_mut(|view| {
        let Some(PoseMatched { psnr, ssim, l1, .. }) = view.pose_matched else { return false };
        (view.psnr, view.ssim, view.l1, view.ms_ssim) = (psnr, ssim, l1, None);
        true
    });
    Ok(evaluation)
}

/// The views of a run: those of the target, with the poses of the arm.
fn views(target: &StudyTarget, dataset: &Dataset, arm: &Arm, seed: u32) -> Result<Views, TrainError> {
    let views = target.views(dataset)?;
    Ok(match arm.pose_error {
        Some(error) => error.applied(views, seed),
        None => views,
    })
}
