//! Flags that `gs fit` and `gs train` share, and what they stand for.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use gs_core::{Loss, Parameterization, effects::Antialias};

use crate::values::whole;

/// How much a fit tells while it runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum Detail {
    /// How far it is.
    #[default]
    Steps,
    /// That, a line for each round of density control, the Gaussians whose scales reach a bound, and the effects that are simulated.
    Rounds,
}

/// When the state of a fit or a training is stored.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Checkpoints")]
pub(crate) struct CheckpointArgs {
    /// Where checkpoints go [default: DIR/checkpoint.safetensors, or checkpoint-2 and so on if another run's checkpoint has that name; removed
    /// when the run is done, unless --checkpoint-every asks for it]
    #[arg(long, value_name = "FILE")]
    pub(crate) checkpoint: Option<PathBuf>,
    /// Save a checkpoint about every STEPS steps [default: every two minutes; also every tenth of all steps, if --checkpoint is
    /// given or a training has 2000 steps or more]
    #[arg(long, value_name = "STEPS", value_parser = whole::<u32>(1..))]
    pub(crate) checkpoint_every: Option<u32>,
}

impl CheckpointArgs {
    /// Whether a flag asks for checkpoints.
    pub(crate) fn are_asked_for(&self) -> bool {
        self.checkpoint.is_some() || self.checkpoint_every.is_some()
    }
}

/// A way of controlling density.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum PolicyName {
    /// Grow where the positional gradient exceeds a fixed threshold (3DGS)
    Absolute,
    /// The same by the absolute gradient, which does not cancel (AbsGS)
    AbsGs,
    /// The same by the error of the pixels that a Gaussian covers (Revising Densification)
    AbsoluteError,
    /// Grow the top percents by positional gradient (the paper's forced growth)
    Percentile,
    /// The same by the absolute gradient
    PercentileAbsGs,
    /// The same by the pixels' error
    PercentileError,
    /// Grow by rank, above a floor and within a budget
    Hybrid,
    /// The same by the absolute gradient
    HybridAbsGs,
    /// The same by the pixels' error
    HybridError,
    /// abs-gs, each split side by side along its long axis instead of cloned or split at random
    LongAxis,
    /// The paper's experiment: the top percents together with the fixed threshold
    Paper,
    /// Move the transparent to the opaque and add 5 % a round, with noise between steps (3DGS-MCMC); needs opacities, so for images --blend over
    Mcmc,
    /// Start with half, add the rest in four parts in proportion to the error (Image-GS)
    ImageGs,
    /// Drop those that contribute least, add where the residual is large
    Residual,
    /// The first Gaussians stay as many as they are
    None,
}

/// What is minimised.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum LossName {
    /// Mean squared difference: the best PSNR
    L2,
    /// Mean absolute difference
    L1,
    /// 0.8 L1 + 0.2 (1 - SSIM), as the paper has it
    L1Dssim,
}

/// In which coordinates the optimiser moves a Gaussian.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum ParameterizationName {
    /// Position, ln-scale and rotation (3DGS)
    ScaleRotation,
    /// The Gaussian's own frame: a step is the same fraction of every Gaussian
    #[value(alias = "local-frame")]
    CovarianceFactor,
}

/// Treatment of Gaussians narrower than a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum AntialiasName {
    /// Nothing
    None,
    /// Widened by 0.3 px² (3DGS)
    Dilate,
    /// Widened by 0.1 px², and fainter for it (Mip-Splatting)
    Mip,
    /// Widened by 0.3 px², and fainter for it (gsplat's and Nerfstudio's `antialiased`)
    Compensated,
}

impl From<LossName> for Loss {
    fn from(name: LossName) -> Self {
        match name {
            LossName::L2 => Self::L2,
            LossName::L1 => Self::L1,
            LossName::L1Dssim => Self::PAPER,
        }
    }
}

impl From<ParameterizationName> for Parameterization {
    fn from(name: ParameterizationName) -> Self {
        match name {
            ParameterizationName::ScaleRotation => Self::ScaleRotation,
            ParameterizationName::CovarianceFactor => Self::CovarianceFactor,
        }
    }
}

impl From<AntialiasName> for Antialias {
    fn from(name: AntialiasName) -> Self {
        match name {
            AntialiasName::None => Self::None,
            AntialiasName::Dilate => Self::Dilate,
            AntialiasName::Mip => Self::Mip,
            AntialiasName::Compensated => Self::Compensated,
        }
    }
}

/// The name of a flag's value, as settings have it.
pub(crate) fn name_of(value: &impl ValueEnum) -> String {
    value.to_possible_value().expect("no value is skipped").get_name().to_owned()
}
