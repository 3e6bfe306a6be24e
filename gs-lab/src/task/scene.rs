//! Runs on scenes: trainings of 3D Gaussians from views.

use gs_backend::FutureExt as _;
use gs_core::{
    Camera, Error as CoreError, Gaussian3d, Image, Optimizer, Parameterization, RenderSettings, Scene3d, math::sh,
};
use gs_density::Policy;
use gs_io::{Checkpoint, dataset::Split};
use gs_train::{
    Error as TrainError, ForeignPolicy, Recovery, TrainPreset, TrainSettings, Trainer, Trainer3d,
    train::{PosedView, ViewQuality},
};

use super::{AnyScene, Asked, Measured, StudyTask, WrongKey, image::wrong_kind};
use crate::{
    arm::{AnyPolicy, Arm},
    clock::Clock,
    digest, overrides,
    record::ViewResult,
    target::StudyTarget,
};

/// Held-out views of each scene that reports show, evenly spread.
pub(crate) const PICTURED_VIEWS: usize = 3;

impl StudyTask for Scene3d {
    const IS_3D: bool = true;

    fn start_settings(asked: &Asked<'_>, target: &StudyTarget) -> Result<TrainSettings, WrongKey> {
        let preset = TrainPreset::ALL.into_iter().find(|preset| preset.name() == asked.preset()).ok_or_else(|| {
            let known = TrainPreset::ALL.map(TrainPreset::name).join(", ");
            WrongKey::new("preset", format!("there is no preset `{}` for scenes: those are {known}", asked.preset()))
        })?;
        let Some(dataset) = target.dataset() else {
            return Err(WrongKey::new("preset", "is for scenes"));
        };
        if let Some(start) = asked.arm.start {
            start.of(dataset).map_err(|error| WrongKey::new("start", format!("{error} ({})", target.label())))?;
        }
        let cameras = dataset.views_of(Split::Train).map(|view| &view.camera);
        let mut settings = preset.settings_for(asked.iterations(), dataset.kind, cameras);
        settings = match asked.arm.like_gs_train {
            // The points of the start may double the preset's number.
            true if settings.gaussians <= asked.budget / 2 => settings,
            true => {
                let gaussians = settings.gaussians.min(asked.budget);
                settings.with_gaussians(gaussians)
            }
            false => settings.with_gaussians(asked.budget),
        };
        // What is wrong with the rounds is reported later, with its place.
        for over in [&asked.study.settings, &asked.arm.settings] {
            settings = overrides::with_rounds(settings, over);
        }
        if let Some(name) = &asked.arm.policy {
            let policy = Policy::from_name(name).map_err(|error| WrongKey::new("policy", error))?;
            settings = settings.with_policy(policy);
            settings.policy.validate_3d().map_err(|error| WrongKey::new("policy", error))?;
        }
        Ok(match asked.arm.parameterization {
            Some(parameterization) => settings.with_parameterization(parameterization),
            None => settings,
        })
    }

    fn completed(settings: TrainSettings, seed: u32) -> TrainSettings {
        settings.with(|s| s.seed = seed)
    }

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
        let views = target.views(dataset)?;
        let start = target.start(arm.start(dataset, &settings), dataset, &views.train)?;
        clock.begin(|| Trainer3d::from_views(rasterizer, views, start, settings).block_on())
    }

    fn resume<'r, R: Optimizer<Self>>(
        rasterizer: &'r R,
        target: &StudyTarget,
        checkpoint: Checkpoint,
    ) -> Result<Trainer<'r, R, Self>, TrainError> {
        let Some(dataset) = target.dataset() else { return Err(wrong_kind(target)) };
        Trainer3d::resume_views(rasterizer, target.views(dataset)?, checkpoint)
    }

    fn measure<R: Optimizer<Self>>(trainer: &Trainer<'_, R, Self>) -> Result<Measured, TrainError> {
        let names: Vec<String> = trainer.evaluation_views().iter().map(|view| view.name.clone()).collect();
        let shown = names.len().min(PICTURED_VIEWS);
        let shown: Vec<&String> = (0..shown).map(|index| &names[index * names.len() / shown]).collect();
        let mut rendered = Vec::new();
        let mut look = |view: &PosedView, image: &Image| {
            if shown.contains(&&view.name) {
                rendered.push((view.name.clone(), image.clone()));
            }
            Ok(())
        };
        let evaluation = trainer.evaluate(&mut look).block_on()?;
        rendered.retain(|(name, _)| !evaluation.unmeasured.contains(name));
        let view = |view: ViewQuality| ViewResult {
            is_shown: rendered.iter().any(|(name, _)| *name == view.name),
            name: view.name,
            psnr: view.psnr,
            ssim: view.ssim,
            ms_ssim: view.ms_ssim,
            l1: view.l1,
            curve: Vec::new(),
        };
        Ok(Measured {
            psnr: evaluation.psnr,
            ssim: evaluation.ssim,
            ms_ssim: evaluation.ms_ssim,
            l1: evaluation.l1,
            loss: None,
            culled: evaluation.culled,
            views: evaluation.views.into_iter().map(view).collect(),
            pictures: rendered.into_iter().map(|(_, image)| image).collect(),
            render: trainer.shown(),
            frame: trainer.views().frame,
        })
    }

    fn draw_one<R: Optimizer<Self>>(
        rasterizer: &R,
        render: &RenderSettings,
        parameterization: Parameterization,
    ) -> Result<(), CoreError> {
        let gaussian = Gaussian3d {
            mean: [0.0, 0.0, 1.0].into(),
            log_scale: [-3.0; 3].into(),
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit: 0.0,
            sh: vec![[0.5; 3].into(); sh::coefficients(render.effects.sh_degree)],
        };
        let mut scene = Self { sh_degree: render.effects.sh_degree, ..Self::default() };
        gs_core::Scene::push(&mut scene, gaussian);
        let splats = rasterizer.upload(&scene, parameterization)?;
        rasterizer.forward(&splats, &Camera::looking_forward(1, 1, 1.0), render).block_on().map(drop)
    }

    fn own(policy: &AnyPolicy) -> Option<&ForeignPolicy<Self>> {
        match policy {
            AnyPolicy::In2d(_) | AnyPolicy::Elsewhere => None,
            AnyPolicy::In3d(policy) => Some(policy),
        }
    }

    fn digest(&self) -> String {
        digest::of_scene_3d(self)
    }

    fn bytes(&self) -> u64 {
        // Mean, scale, rotation, opacity, and SH.
        4 * (11 * self.means.len() + 3 * self.sh.len()) as u64
    }

    fn wrapped(self) -> AnyScene {
        AnyScene::In3d(self)
    }
}
