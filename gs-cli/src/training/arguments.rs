//! Flags that `gs fit` and `gs train` share, and the values behind them.

use std::path::PathBuf;

use clap::{Args, ValueEnum, builder::PossibleValue};
use gs_core::{Loss, Parameterization};
use gs_density::Policy;

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
    /// is another run's; removed at the end, unless this flag or --checkpoint-every is given]
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

/// A density-control policy by its name in gs-density.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct PolicyName(pub(crate) &'static str);

impl PolicyName {
    /// The names of policies that pass this test.
    pub(crate) fn those(pass: impl Fn(&Policy) -> bool) -> impl Iterator<Item = Self> {
        let passes = move |name: &Self| Policy::from_name(name.0).is_ok_and(|policy| pass(&policy));
        Policy::NAMES.into_iter().map(Self).filter(passes)
    }

    /// The name as a value of a flag, with what the policy does.
    pub(crate) fn to_possible_value(self) -> Option<PossibleValue> {
        Some(PossibleValue::new(self.0).help(Policy::summary(self.0).unwrap_or_default()))
    }
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
