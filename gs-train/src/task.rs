//! What one kind of training adds to the loop that all kinds share: its settings, and its course, which knows the pictures to reach.

use std::{fmt::Debug, future::Future};

use gs_core::{Effects, Loss, Optimizer, Parameterization};
use gs_density::{DensityPolicy, DensityScene, Residual};
use serde::{Serialize, de::DeserializeOwned};

use crate::{error::Error, observer::Quality, recovery::Recovery, rounds::Rounds};

/// A kind of scene that [`Trainer`](crate::Trainer) can train.
pub trait Trainable: DensityScene {
    /// Everything that its training depends on besides pictures and backend.
    type Settings: RunSettings<Self>;
    /// Its part of the loop.
    type TrainingTask<R: Optimizer<Self>>: TrainingTask<R, Self>;

    /// All parameters of a Gaussian but its opacity, with their names and units, for people.
    fn parameters(gaussian: &Self::Gaussian) -> Vec<(&'static str, Vec<f32>)>;

    /// The smallest and the largest ln-scale of Gaussian `index`.
    ///
    /// # Panics
    /// When there is no such Gaussian.
    fn log_scale_range(&self, index: usize) -> (f32, f32);
}

/// What the loop must know of a run's settings.
pub trait RunSettings<S: Trainable>: Clone + Debug + PartialEq + Serialize + DeserializeOwned {
    /// What a checkpoint says it is of, so that one of another kind of training is refused.
    const FORMAT: &'static str;

    /// Fails where a setting is out of its range or contradicts another.
    ///
    /// # Errors
    /// [`gs_core::Error::Setting`] naming the first offender.
    fn validate(&self) -> Result<(), gs_core::Error>;
    /// Steps of the optimiser.
    fn iterations(&self) -> u32;
    /// Where all random numbers come from.
    fn seed(&self) -> u32;
    /// The most Gaussians there may be.
    fn budget(&self) -> u32;
    /// When density is controlled.
    fn rounds(&self) -> &Rounds;
    /// In which coordinates the optimiser moves.
    fn parameterization(&self) -> Parameterization;
    /// How it is.
    fn policy(&self) -> &dyn DensityPolicy<S>;
    /// The effects of the step that follows `step` steps, by the effect schedule; statistics are a matter of the policy.
    fn effects_after(&self, step: u32) -> Effects;
    /// What the position's learning rate has become after `step` steps, as a multiple of what it was at first.
    fn mean_factor(&self, step: u32) -> f32;
    /// Between what the optimiser keeps every scale, in the scene's unit.
    fn scale_bounds(&self) -> (f32, f32);
    /// What is minimised.
    fn loss(&self) -> Loss;
    /// An estimate of PSNR from this loss, dB, where there is one.
    fn psnr_estimate(&self, loss: f32) -> Option<f32>;
    /// What becomes of a run that has become worse than it was at first.
    fn recovery(&self) -> Recovery;
    /// Whether the step that follows `step` steps makes its lists anew, whatever came before.
    fn bins_afresh_after(&self, step: u32) -> bool;
}

/// What a course is told of the step that it is to send.
#[derive(Debug, Clone, Copy)]
pub struct StepContext {
    /// Steps done before it.
    pub step: u32,
    /// The effects of the step, with the statistics that density control wants.
    pub effects: Effects,
    /// What is left of the learning rates of the settings: 1 unless the run had to begin again.
    pub lr_scale: f32,
    /// Whether lists may be used again.
    pub binning: gs_core::Binning,
}

/// The part of the loop that knows what the pictures are.
pub trait TrainingTask<R: Optimizer<S>, S: Trainable> {
    /// The scene's extent as [`Observation`](gs_density::Observation) has it.
    fn extent(&self) -> f32;

    /// How many pictures there are to train with.
    fn pictures(&self) -> u32;

    /// Sends one step of the optimiser.
    ///
    /// # Errors
    /// Those of the backend, and of reading a picture.
    fn send(
        &mut self,
        on: &R,
        splats: &mut R::Splats,
        settings: &S::Settings,
        context: StepContext,
    ) -> impl Future<Output = Result<(), Error>>;

    /// The residual that a policy asks for, where there is one.
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

    /// Follows an edit of density control.
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

    /// How good the scene is with these effects; [`Quality::clamped`] is left to the loop.
    ///
    /// # Errors
    /// Those of the backend, and of reading a picture.
    fn quality(
        &self,
        on: &R,
        splats: &R::Splats,
        settings: &S::Settings,
        effects: &Effects,
    ) -> impl Future<Output = Result<Quality, Error>>;
}
