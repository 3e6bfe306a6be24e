//! Runs on images: fits of 2D Gaussians.

use gs_backend::FutureExt as _;
use gs_core::{
    Blend, Canvas, Error as CoreError, Gaussian2d, Image, Optimizer, Parameterization, RenderSettings, Scene2d,
};
use gs_io::Checkpoint;
use gs_train::{Error as TrainError, FitSettings, FitSummary, Recovery, Trainer};

use super::{Finished, StudyTask, shapes, start};
use crate::study::{Arm, Clock, Column, Measure, StudyTarget, digest};

impl StudyTask for Scene2d {
    fn without_recovery(settings: &FitSettings) -> FitSettings {
        settings.clone().with(|s| s.recovery = Recovery::Never)
    }

    fn begin<'r, R: Optimizer<Self>>(
        rasterizer: &'r R,
        target: &StudyTarget,
        _: &Arm,
        settings: FitSettings,
        clock: Clock,
    ) -> Result<Trainer<'r, R, Self>, TrainError> {
        let Some(image) = target.image() else { return Err(wrong_kind(target)) };
        clock.begin(|| Trainer::new(rasterizer, image, settings).block_on())
    }

    fn resume<'r, R: Optimizer<Self>>(
        rasterizer: &'r R,
        target: &StudyTarget,
        _: (&Arm, u32),
        checkpoint: Checkpoint,
    ) -> Result<Trainer<'r, R, Self>, TrainError> {
        let Some(image) = target.image() else { return Err(wrong_kind(target)) };
        Trainer::resume(rasterizer, image, checkpoint)
    }

    fn measure<R: Optimizer<Self>>(
        trainer: &Trainer<'_, R, Self>,
        _: bool,
        finished: &mut Finished,
    ) -> Result<Vec<Image>, TrainError> {
        let (image, culled) = trainer.render().block_on()?;
        let FitSummary { psnr, ssim, ms_ssim, l1, loss, .. } = FitSummary::new(trainer, &image, culled).block_on()?;
        *finished = Finished { psnr, ssim, ms_ssim, l1, loss, culled, ..finished.clone() };
        Ok(vec![image])
    }

    fn further<R: Optimizer<Self>>(
        measure: Measure,
        rasterizer: &R,
        target: &StudyTarget,
        settings: &FitSettings,
        scene: &Self,
    ) -> Result<Vec<(Column, f64)>, TrainError> {
        let Some(image) = target.image() else { return Err(wrong_kind(target)) };
        match measure {
            Measure::Start => start::measure(rasterizer, image, settings),
            Measure::Shapes => Ok(shapes::measure(scene)),
        }
    }

    fn draw_one<R: Optimizer<Self>>(rasterizer: &R, render: &RenderSettings) -> Result<(), CoreError> {
        let gaussian = Gaussian2d {
            mean: [0.5; 2].into(),
            log_scale: [0.0; 2].into(),
            rotation: 0.0,
            opacity_logit: if render.effects.blend == Blend::Sum { f32::INFINITY } else { 0.0 },
            color: [0.5; 3].into(),
        };
        let splats = rasterizer.upload(&[gaussian].into_iter().collect(), Parameterization::ScaleRotation)?;
        rasterizer.forward(&splats, &Canvas::new(1, 1), render).block_on().map(drop)
    }

    fn digest(&self) -> String {
        digest::of_scene(self)
    }

    fn bytes(&self) -> u64 {
        // Mean, scale, rotation and colour, and opacity where there is one.
        let opacities = self.opacity_logits.iter().filter(|logit| logit.is_finite()).count();
        4 * (8 * self.means.len() + opacities) as u64
    }
}

/// The error of a run whose settings are not those of its target; a plan has none.
pub(super) fn wrong_kind(target: &StudyTarget) -> TrainError {
    CoreError::State(format!("the settings are not those of a run on {}", target.name)).into()
}
