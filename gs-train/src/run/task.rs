//! The part of the training loop that differs between kinds of training: settings, and the task,
//! which knows the target images.

use std::fmt::Debug;

use gs_core::{Effects, Loss, Optimizer, Parameterization, examination::Examinable};
use gs_density::{DensityGaussian as _, DensityPolicy, DensityScene, Evidence, EvidenceRequest, Policy, Residual};

use super::{observer::Quality, recovery::Recovery, rounds::Rounds, settings_file::SettingsFile, suspect::Suspect};
use crate::error::Error;

/// A kind of scene that [`Trainer`](crate::Trainer) can train: [`Scene2d`](gs_core::Scene2d), whose
/// settings are [`FitSettings`](crate::FitSettings), and [`Scene3d`](gs_core::Scene3d), whose
/// settings are [`TrainSettings`](crate::TrainSettings).
///
/// Other crates cannot implement it, because its type [`TrainingTask`](Self::TrainingTask) needs a
/// trait of this crate: what the training loop needs of a kind of scene changes with the loop.
pub trait Trainable: DensityScene + Examinable {
    /// Everything that a run depends on besides images and backend.
    type Settings: RunSettings<Self>;
    /// The part of the loop that knows the images.
    type TrainingTask<R: Optimizer<Self>>: TrainingTask<R, Self>;

    /// All parameters of a Gaussian except its opacity, with names and units for messages.
    fn parameters(gaussian: &Self::Gaussian) -> Vec<(&'static str, Vec<f32>)>;

    /// Smallest and largest ln-scale of Gaussian `index`.
    ///
    /// # Panics
    /// Where there is no such Gaussian.
    fn log_scale_range(&self, index: usize) -> (f32, f32);

    /// All parameters of all Gaussians, an array for each kind.
    fn numbers_mut(&mut self) -> Vec<&mut [f32]>;
}

impl Suspect {
    /// The suspect of a scene; `None` for an empty scene.
    pub(crate) fn of<S: Trainable>(scene: &S) -> Option<Self> {
        let worst = |index: usize| {
            let gaussian = scene.gaussian(index);
            let values = S::parameters(&gaussian).into_iter().flat_map(|(_, values)| values);
            let largest = values.fold(0.0f32, |m, v| if v.is_finite() { m.max(v.abs()) } else { f32::INFINITY });
            if gaussian.opacity_logit().is_nan() { f32::INFINITY } else { largest }
        };
        let worst: Vec<f32> = (0..scene.len()).map(worst).collect();
        let not_finite = worst.iter().filter(|&&worst| worst == f32::INFINITY).count();
        // The first of several equals.
        let index = (0..scene.len()).reduce(|a, b| if worst[b] > worst[a] { b } else { a })?;
        let gaussian = scene.gaussian(index);
        let (parameters, opacity_logit) = (S::parameters(&gaussian), gaussian.opacity_logit());
        Some(Self { index, parameters, opacity_logit, not_finite })
    }
}

/// The settings of a run that both kinds of training have: [`RunSettings::of_loop`] returns them.
#[derive(Debug, Clone, Copy)]
pub struct LoopSettings<'s> {
    /// Number of steps.
    pub iterations: u32,
    /// Seed of all random numbers.
    pub seed: u32,
    /// Largest number of Gaussians.
    pub budget: u32,
    /// Whether the run ends with exactly as many.
    pub exactly: bool,
    /// Rounds of density control.
    pub rounds: &'s Rounds,
    /// Policy of density control.
    pub policy: &'s Policy,
    /// Loss to minimise.
    pub loss: Loss,
    /// What happens to a diverging run.
    pub recovery: Recovery,
}

/// Settings of a run as the training loop reads them: [`FitSettings`](crate::FitSettings) and
/// [`TrainSettings`](crate::TrainSettings).
pub trait RunSettings<S: Trainable>: SettingsFile + Clone + Debug + PartialEq {
    /// Format name in checkpoints, so that a checkpoint of another kind of training is refused.
    const FORMAT: &'static str;

    /// Checks the ranges of all settings.
    ///
    /// # Errors
    /// [`gs_core::Error::Setting`] naming the first value outside its range.
    fn validate(&self) -> Result<(), gs_core::Error>;
    /// The settings that have the same meaning for both kinds of scenes.
    fn of_loop(&self) -> LoopSettings<'_>;
    /// Policy of density control.
    fn policy(&self) -> &dyn DensityPolicy<S>;
    /// Coordinates in which the optimizer moves.
    fn parameterization(&self) -> Parameterization {
        Parameterization::ScaleRotation
    }
    /// Share of the run, at its end, whose scenes are averaged.
    fn average_last(&self) -> f32 {
        0.0
    }
    /// Number of Gaussians, the first of the scene, that the run leaves as they are.
    fn fixed(&self) -> u32 {
        0
    }
    /// Whether the budget is only a bound: a default that the policy does not aim at.
    fn budget_is_bound(&self) -> bool {
        false
    }
    /// Effects of the step after `step` steps, by the effect schedule; the policy decides about
    /// statistics.
    fn effects_after(&self, step: u32) -> Effects;
    /// Learning rate of means after `step` steps, relative to its first value.
    fn mean_factor(&self, step: u32) -> f32;
    /// Lower and upper bound of every scale, in the scene's unit.
    fn scale_bounds(&self) -> (f32, f32);
    /// Whether the step after `step` steps always makes new lists.
    fn bins_afresh_after(&self, step: u32) -> bool;
}

/// The methods of [`RunSettings`] that say the same of settings whose fields have the same names.
macro_rules! same_settings {
    ($Scene:ty) => {
        fn validate(&self) -> Result<(), gs_core::Error> {
            self.validate()
        }

        fn of_loop(&self) -> crate::run::LoopSettings<'_> {
            let Self { iterations, seed, gaussians: budget, exactly, loss, recovery, .. } = *self;
            let (rounds, policy) = (&self.rounds, &self.policy);
            crate::run::LoopSettings { iterations, seed, budget, exactly, rounds, policy, loss, recovery }
        }

        fn policy(&self) -> &dyn gs_density::DensityPolicy<$Scene> {
            &self.policy
        }
    };
}

pub(crate) use same_settings;

/// Context of a step that a task sends.
#[derive(Debug, Clone, Copy)]
pub struct StepContext {
    /// Number of steps done before this step.
    pub step: u32,
    /// Effects of the step, with the statistics that density control needs.
    pub effects: Effects,
    /// Depth from which gradients count fully in the statistics, world units:
    /// [`RenderSettings::full_depth`](gs_core::RenderSettings::full_depth).
    pub full_depth: f32,
    /// Learning-rate scale: 1 unless the run has restarted.
    pub lr_scale: f32,
    /// Fresh or reused lists.
    pub binning: gs_core::Binning,
}

/// The state of a run that a task is asked about.
#[expect(missing_debug_implementations, reason = "splats have none")]
pub struct At<'r, R: Optimizer<S>, S: Trainable> {
    /// The backend.
    pub on: &'r R,
    /// The Gaussians.
    pub splats: &'r R::Splats,
    /// The settings.
    pub settings: &'r S::Settings,
    /// The effects of the scene. Statistics are off, except in [`TrainingTask::prepare`]: it gets
    /// those of the step.
    pub effects: Effects,
}

/// The part of the loop that knows the target images.
#[expect(async_fn_in_trait, reason = "the trait is sealed, and its futures are not `Send`")]
pub trait TrainingTask<R: Optimizer<S>, S: Trainable> {
    /// Whether there are views to gather evidence from.
    const HAS_VIEWS: bool;

    /// Extent of the scene, as in [`Observation::extent`](gs_density::Observation::extent).
    fn extent(&self) -> f32;

    /// Number of images to train with.
    fn images(&self) -> u32;

    /// Estimate of PSNR from this loss, dB, where there is one.
    fn psnr_estimate(&self, _settings: &S::Settings, _loss: f32) -> Option<f32> {
        None
    }

    /// Prepares for the step after `step` steps; called once before [`Self::send`] of each step.
    ///
    /// # Errors
    /// Those of the backend, and of reading an image.
    async fn prepare(&mut self, _at: At<'_, R, S>, _step: u32) -> Result<(), Error> {
        Ok(())
    }

    /// Keys and texts of the task's own state in the metadata of a checkpoint.
    ///
    /// # Errors
    /// [`Error::Checkpoint`] where it cannot be written.
    fn state(&self) -> Result<Vec<(&'static str, String)>, Error> {
        Ok(Vec::new())
    }

    /// Sends one step of the optimizer.
    ///
    /// # Errors
    /// Those of the backend, and of reading an image.
    async fn send(
        &mut self,
        on: &R,
        splats: &mut R::Splats,
        settings: &S::Settings,
        context: StepContext,
    ) -> Result<(), Error>;

    /// Takes what the steps that were sent report to the task, before a checkpoint.
    ///
    /// # Errors
    /// Those of the backend.
    async fn settle(&mut self, _on: &R, _splats: &mut R::Splats) -> Result<(), Error> {
        Ok(())
    }

    /// The residual for a policy that needs it, where there is one.
    ///
    /// # Errors
    /// Those of the backend.
    async fn residual(&mut self, _at: At<'_, R, S>) -> Result<Option<&Residual>, Error> {
        Ok(None)
    }

    /// The evidence for a policy that requests it, of this scene, which is that of the splats, after
    /// `step` steps; `None` without views.
    ///
    /// # Errors
    /// Those of the backend, and of reading an image.
    async fn evidence(
        &mut self,
        _at: At<'_, R, S>,
        _scene: &S,
        _step: u32,
        _request: EvidenceRequest,
    ) -> Result<Option<Evidence>, Error> {
        Ok(None)
    }

    /// Gaussians of this scene that the end of the run removes, by index, ascending.
    fn unwanted(&self, _scene: &S, _settings: &S::Settings, _effects: &Effects) -> Vec<u32> {
        Vec::new()
    }

    /// Called after an edit of density control.
    ///
    /// # Errors
    /// Those of the backend.
    async fn after_edit(
        &mut self,
        _on: &R,
        _splats: &mut R::Splats,
        _settings: &S::Settings,
        _effects: &Effects,
    ) -> Result<(), Error> {
        Ok(())
    }

    /// Quality of the scene; the loop adds [`Quality::clamped`].
    ///
    /// # Errors
    /// Those of the backend, and of reading an image.
    async fn quality(&self, at: At<'_, R, S>) -> Result<Quality, Error>;
}
