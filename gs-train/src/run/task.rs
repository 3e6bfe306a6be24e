//! The part of the training loop that differs between kinds of training: settings, and the task,
//! which knows the target images.

use std::{fmt::Debug, future::Future};

use gs_core::{Effects, Loss, Optimizer, Parameterization};
use gs_density::{
    CountSchedule, DensityGaussian as _, DensityPolicy, DensityScene, Evidence, EvidenceRequest, Policy, Residual,
};

use super::{observer::Quality, recovery::Recovery, rounds::Rounds, settings_file::SettingsFile, suspect::Suspect};
use crate::error::Error;

/// A kind of scene that [`Trainer`](crate::Trainer) can train: [`Scene2d`](gs_core::Scene2d), whose
/// settings are [`FitSettings`](crate::FitSettings), and [`Scene3d`](gs_core::Scene3d), whose
/// settings are [`TrainSettings`](crate::TrainSettings).
///
/// Sealed: what the training loop needs of a kind of scene changes with the loop.
pub trait Trainable: SceneTask {}

impl<S: SceneTask> Trainable for S {}

/// The sealed part of [`Trainable`].
pub trait SceneTask: DensityScene {
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

/// Settings of a run as the loop needs them.
pub trait RunSettings<S: SceneTask>: SettingsFile + Clone + Debug + PartialEq {
    /// Format name in checkpoints, so that a checkpoint of another kind of training is refused.
    const FORMAT: &'static str;

    /// Checks the ranges of all settings.
    ///
    /// # Errors
    /// [`gs_core::Error::Setting`] naming the first value outside its range.
    fn validate(&self) -> Result<(), gs_core::Error>;
    /// Number of steps.
    fn iterations(&self) -> u32;
    /// Seed of all random numbers.
    fn seed(&self) -> u32;
    /// Largest number of Gaussians.
    fn budget(&self) -> u32;
    /// Holds the policy to a schedule that ends at exactly the budget, if asked for.
    fn count_schedule(&self) -> Option<CountSchedule>;
    /// Rounds of density control.
    fn rounds(&self) -> &Rounds;
    /// Coordinates in which the optimizer moves.
    fn parameterization(&self) -> Parameterization {
        Parameterization::ScaleRotation
    }
    /// Policy of density control.
    fn policy(&self) -> &dyn DensityPolicy<S>;
    /// The same policy by its kind.
    fn named_policy(&self) -> &Policy;
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
    /// Loss to minimise.
    fn loss(&self) -> Loss;
    /// What happens to a diverging run.
    fn recovery(&self) -> Recovery;
    /// Whether the step after `step` steps always makes new lists.
    fn bins_afresh_after(&self, step: u32) -> bool;
}

/// Implements [`RunSettings`] for settings whose fields have the usual names; the block has what differs.
macro_rules! impl_run_settings {
    ($Settings:ty, $Scene:ty, { $($own:tt)* }) => {
        impl $crate::run::RunSettings<$Scene> for $Settings {
            $($own)*

            fn validate(&self) -> Result<(), gs_core::Error> {
                self.validate()
            }

            fn iterations(&self) -> u32 {
                self.iterations
            }

            fn seed(&self) -> u32 {
                self.seed
            }

            fn budget(&self) -> u32 {
                self.gaussians
            }

            fn count_schedule(&self) -> Option<gs_density::CountSchedule> {
                self.exactly.then(|| gs_density::CountSchedule::from(&self.policy))
            }

            fn rounds(&self) -> &$crate::run::Rounds {
                &self.rounds
            }

            fn policy(&self) -> &dyn gs_density::DensityPolicy<$Scene> {
                &self.policy
            }

            fn named_policy(&self) -> &gs_density::Policy {
                &self.policy
            }

            fn loss(&self) -> gs_core::Loss {
                self.loss
            }

            fn recovery(&self) -> $crate::run::Recovery {
                self.recovery
            }
        }
    };
}

pub(crate) use impl_run_settings;

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

/// The part of the loop that knows the target images.
pub trait TrainingTask<R: Optimizer<S>, S: SceneTask> {
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
    fn prepare(
        &mut self,
        _on: &R,
        _splats: &R::Splats,
        _settings: &S::Settings,
        _context: StepContext,
    ) -> impl Future<Output = Result<(), Error>> {
        async { Ok(()) }
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
    fn send(
        &mut self,
        on: &R,
        splats: &mut R::Splats,
        settings: &S::Settings,
        context: StepContext,
    ) -> impl Future<Output = Result<(), Error>>;

    /// The residual for a policy that needs it, where there is one.
    ///
    /// # Errors
    /// Those of the backend.
    fn residual(
        &mut self,
        on: &R,
        splats: &R::Splats,
        settings: &S::Settings,
        effects: &Effects,
    ) -> impl Future<Output = Result<Option<&Residual>, Error>>;

    /// The evidence for a policy that requests it, of the scene of these splats after `step` steps;
    /// `None` without views.
    ///
    /// # Errors
    /// Those of the backend, and of reading an image.
    fn evidence(
        &mut self,
        on: &R,
        of: (&S, &R::Splats),
        settings: &S::Settings,
        at: (u32, &Effects),
        request: EvidenceRequest,
    ) -> impl Future<Output = Result<Option<Evidence>, Error>>;

    /// Gaussians of this scene that the end of the run removes, by index, ascending.
    fn unwanted(&self, _scene: &S, _settings: &S::Settings, _effects: &Effects) -> Vec<u32> {
        Vec::new()
    }

    /// Called after an edit of density control.
    ///
    /// # Errors
    /// Those of the backend.
    fn after_edit(
        &mut self,
        on: &R,
        splats: &mut R::Splats,
        settings: &S::Settings,
        effects: &Effects,
    ) -> impl Future<Output = Result<(), Error>>;

    /// Quality of the scene with these effects; the loop adds [`Quality::clamped`].
    ///
    /// # Errors
    /// Those of the backend, and of reading an image.
    fn quality(
        &self,
        on: &R,
        splats: &R::Splats,
        settings: &S::Settings,
        effects: &Effects,
    ) -> impl Future<Output = Result<Quality, Error>>;
}
