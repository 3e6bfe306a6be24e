//! Flags that `gs fit` and `gs train` share.

use std::path::{Path, PathBuf};

use clap::{
    Args,
    builder::{PossibleValue, PossibleValuesParser, TypedValueParser},
};
use gs_density::Policy;
use gs_io::{FolderClaim, Inputs};

use super::{checkpoints::CheckpointPlan, job::Job, phases::Phases, results};
use crate::{
    failure::Failure,
    files::output_folder::OverwriteArgs,
    flags::{backend::BackendArgs, effects_args::EffectsArgs, values::whole},
    terminal::output::Verbosity,
};

/// The flags of a run besides its input and its settings.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = None::<&str>)]
pub(crate) struct RunArgs {
    /// Folder for the results; made if necessary
    #[arg(short, long, value_name = "DIR", default_value = "gs-out")]
    pub(crate) output: PathBuf,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Print the summary as JSON on standard output, and nothing else there
    #[arg(long)]
    pub(crate) json: bool,
    /// Leave out the pictures that explain the result: curve.svg, ellipses.png, and views/ of gs
    /// train
    #[arg(long)]
    no_report: bool,
    /// Also print each round of density control, Gaussians whose size reaches a bound, and the
    /// effects that are simulated and why
    #[arg(short, long)]
    verbose: bool,
    /// File for checkpoints [default: DIR/checkpoint.safetensors, or checkpoint-2 and so on if that
    /// is another run's; removed at the end, unless this flag or --checkpoint-every is given]
    #[arg(long, value_name = "FILE", help_heading = "Checkpoints")]
    pub(crate) checkpoint: Option<PathBuf>,
    /// Save a checkpoint about every STEPS steps [default: every two minutes, and every tenth of
    /// the steps if --checkpoint is given or a training has 2000 steps or more]
    #[arg(long, value_name = "STEPS", value_parser = whole::<u32>(1..), help_heading = "Checkpoints")]
    checkpoint_every: Option<u32>,
    #[command(flatten)]
    pub(crate) effects: EffectsArgs,
    #[command(flatten)]
    pub(crate) backend: BackendArgs,
}

impl RunArgs {
    /// Flags of a run that writes into this folder, and keeps its last checkpoint in this file.
    pub(crate) fn within(output: PathBuf, overwrite: OverwriteArgs, checkpoint: PathBuf, backend: BackendArgs) -> Self {
        Self {
            output,
            overwrite,
            json: false,
            no_report: false,
            verbose: false,
            checkpoint: Some(checkpoint),
            checkpoint_every: None,
            effects: EffectsArgs::default(),
            backend,
        }
    }

    /// A run with these flags that writes into this folder and reads these files, besides the checkpoint
    /// that it resumes.
    ///
    /// # Errors
    /// Those of [`CheckpointPlan::check`].
    pub(crate) fn job(&self, folder: &Path, inputs: &[PathBuf], resumed: Option<&Path>) -> Result<Job, Failure> {
        let claim = self.claim(folder, inputs, resumed);
        let (file, every) = (self.checkpoint.clone(), self.checkpoint_every);
        let checkpoints = CheckpointPlan { file, every, resumed: resumed.map(Path::to_owned) };
        checkpoints.check(inputs, self.overwrite.overwrite, &claim)?;
        Ok(Job {
            claim,
            json: self.json,
            pictures: !self.no_report,
            verbosity: if self.verbose { Verbosity::Verbose } else { Verbosity::Normal },
            checkpoints,
            effects: self.effects.choice(),
            phases: Phases::begin(),
        })
    }

    /// The claim of such a run to its folder.
    pub(crate) fn claim(&self, folder: &Path, inputs: &[PathBuf], resumed: Option<&Path>) -> FolderClaim {
        let read: Inputs = inputs.iter().map(PathBuf::as_path).chain(resumed).collect();
        self.overwrite.claim(folder, results::FILES, read)
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
