//! Flags that `gs fit` and `gs train` share.

use std::path::PathBuf;

use clap::{
    Args,
    builder::{PossibleValue, PossibleValuesParser, TypedValueParser},
};
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

/// A parser of density-control policies by name. `offered` chooses them, and gives what the help adds to
/// the summary of a policy.
pub(crate) fn policy_by_name(
    offered: impl Fn(&Policy) -> Option<&'static str>,
) -> impl TypedValueParser<Value = Policy> {
    let possible = Policy::NAMES.into_iter().filter_map(|name| {
        let added = offered(&Policy::from_name(name).ok()?)?;
        Some(PossibleValue::new(name).help(format!("{}{added}", Policy::summary(name)?)))
    });
    PossibleValuesParser::new(possible.collect::<Vec<_>>())
        .map(|name| Policy::from_name(&name).expect("it is one of the possible values"))
}
