//! Flags that `gs fit` and `gs train` share, and the values behind them.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use gs_core::{Loss, Parameterization};

use crate::{output::Verbosity, output_folder::OverwriteArgs, values::whole};

/// Where results go, and what is printed.
#[derive(Debug, Clone, Args)]
pub(crate) struct OutputArgs {
    /// Folder for the results; made if necessary
    #[arg(short, long, value_name = "DIR", default_value = "gs-out")]
    pub(crate) output: PathBuf,
    #[command(flatten)]
    pub(crate) overwrite: OverwriteArgs,
    /// Print the summary as JSON on standard output, and nothing else there
    #[arg(long)]
    pub(crate) json: bool,
    /// Leave out the pictures that explain the result: curve.png, ellipses.png, and views/ of gs
    /// train
    #[arg(long)]
    pub(crate) no_report: bool,
    /// Also print each round of density control, Gaussians whose size reaches a bound, and the
    /// effects that are simulated and why
    #[arg(short, long)]
    verbose: bool,
}

impl OutputArgs {
    /// How much is printed.
    pub(crate) fn verbosity(&self) -> Verbosity {
        if self.verbose { Verbosity::Verbose } else { Verbosity::Normal }
    }
}

/// Where checkpoints are stored, and when.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Checkpoints")]
pub(crate) struct CheckpointArgs {
    /// File for checkpoints [default: DIR/checkpoint.safetensors, or checkpoint-2 and so on if that
    /// is another run's; removed at the end, unless --checkpoint-every is given]
    #[arg(long, value_name = "FILE")]
    pub(crate) checkpoint: Option<PathBuf>,
    /// Save a checkpoint about every STEPS steps [default: every two minutes, and every tenth of
    /// the steps if --checkpoint is given or a training has 2000 steps or more]
    #[arg(long, value_name = "STEPS", value_parser = whole::<u32>(1..))]
    pub(crate) checkpoint_every: Option<u32>,
}

impl CheckpointArgs {
    /// Whether a flag asks for checkpoints.
    pub(crate) fn request_some(&self) -> bool {
        self.checkpoint.is_some() || self.checkpoint_every.is_some()
    }
}

/// A density-control policy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum PolicyName {
    /// Grow where the positional gradient exceeds a fixed threshold (3DGS)
    Absolute,
    /// Grow where the absolute gradient, which does not cancel, exceeds a threshold (AbsGS)
    AbsGs,
    /// Grow where the error of the covered pixels exceeds a threshold (Revising Densification)
    AbsoluteError,
    /// Grow the top percents by positional gradient (the paper's forced growth)
    Percentile,
    /// Grow the top percents by absolute gradient
    PercentileAbsGs,
    /// Grow the top percents by the error of the covered pixels
    PercentileError,
    /// Grow by rank of the positional gradient, above a floor and within a budget
    Hybrid,
    /// Grow by rank of the absolute gradient, above a floor and within a budget
    HybridAbsGs,
    /// Grow by rank of the error of the covered pixels, above a floor and within a budget
    HybridError,
    /// Grow as abs-gs does, but split side by side along the long axis
    LongAxis,
    /// The paper's experiment: the top percents together with the fixed threshold
    Paper,
    /// Move transparent Gaussians to opaque ones and add 5 % a round, with noise between steps
    /// (3DGS-MCMC); for images, needs --blend over
    Mcmc,
    /// Grow and prune by the pixels of high error that a Gaussian covers in several views (FastGS);
    /// only in gs train
    #[value(name = "fastgs")]
    FastGs,
    /// Grow by a score of errors, edges, sizes and contributions over several views, along a schedule
    /// that ends at the budget (Taming 3DGS); only in gs train
    Taming,
    /// Split Gaussians that draw edges, side by side along the long axis, on a schedule that ends
    /// at the budget (Improved-GS); only in gs train
    ImprovedGs,
    /// Start with half, add the rest in four rounds in proportion to the error (Image-GS)
    ImageGs,
    /// Drop those that contribute least, add where the residual is large
    Residual,
    /// Keep the initial Gaussians
    None,
}

/// A loss.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum LossName {
    /// Mean squared difference: the best PSNR
    L2,
    /// Mean absolute difference
    L1,
    /// 0.8 L1 + 0.2 (1 - SSIM), as in the paper
    L1Dssim,
}

/// The coordinates of the optimizer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum ParameterizationName {
    /// Position, ln-scale and rotation (3DGS)
    ScaleRotation,
    /// The Gaussian's own coordinates, where a step is the same fraction of every Gaussian
    #[value(alias = "local-frame")]
    CovarianceFactor,
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

/// The name of a flag's value, which is the same in settings files.
pub(crate) fn name_of(value: &impl ValueEnum) -> String {
    value.to_possible_value().expect("no value is skipped").get_name().to_owned()
}
