//! A run of `gs fit` or `gs train` as its flags ask for it.

use gs_backend::AnyRasterizer;
use gs_core::Optimizer;
use gs_io::FolderClaim;
use gs_train::{Trainable, Trainer};

use super::{
    checkpoints::{CheckpointPlan, Checkpoints},
    phases::Phases,
};
use crate::{
    failure::Failure, files::output_folder::OutputFolder, flags::effects_args::EffectsChoice,
    terminal::output::Verbosity,
};

/// What both kinds of runs have besides their input and their settings.
#[derive(Debug)]
pub(crate) struct Job {
    /// The output folder, the files in it that the run writes, and those that it reads.
    pub(crate) claim: FolderClaim,
    /// Whether the summary is printed as JSON.
    pub(crate) json: bool,
    /// Whether pictures that explain the result are drawn.
    pub(crate) pictures: bool,
    /// How much is printed.
    pub(crate) verbosity: Verbosity,
    pub(crate) checkpoints: CheckpointPlan,
    /// Which effects are simulated.
    pub(crate) effects: EffectsChoice,
    /// How long the phases take.
    pub(crate) phases: Phases,
}

/// A run that has its folder.
#[derive(Debug)]
pub(crate) struct Run {
    pub(crate) job: Job,
    pub(crate) folder: OutputFolder,
    /// Time before the checkpoint that was resumed, s.
    seconds_before: f64,
}

impl Run {
    /// The whole time of the program, including that of the run before it was resumed, s.
    pub(crate) fn seconds(&self) -> f64 {
        self.seconds_before + self.job.phases.started().elapsed().as_secs_f64()
    }
}

impl Job {
    /// Begins the run of this trainer in its folder. `every` is the default number of steps between
    /// checkpoints, `command` the command that resumes the run, without its flag `--resume`.
    pub(crate) fn begin<S: Trainable>(
        self,
        trainer: &Trainer<'_, AnyRasterizer, S>,
        every: Option<u32>,
        command: String,
    ) -> Result<(Run, Checkpoints), Failure>
    where
        AnyRasterizer: Optimizer<S>,
    {
        let folder = OutputFolder::begin(self.claim.clone())?;
        let checkpoints = Checkpoints::prepare(&self.checkpoints, &folder, trainer.iterations(), every, command)?;
        let seconds_before = if self.checkpoints.resumed.is_some() { trainer.seconds() } else { 0.0 };
        Ok((Run { job: self, folder, seconds_before }, checkpoints))
    }
}
