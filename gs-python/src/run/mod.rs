//! Fits and trainings: runs in a thread of their own, which Python follows as iterators.

mod fit;
mod progress;
mod train;
mod worker;

use std::{
    fs,
    path::{Path, PathBuf},
    sync::Arc,
};

use gs_backend::{AnyRasterizer, block_on};
use gs_io::Checkpoint;
use gs_train::{Outcome, Trainable, Trainer};
use pyo3::{exceptions::PyOSError, prelude::*};

pub(crate) use self::{
    fit::{Fit, FitRun},
    progress::Progress,
    train::{TrainRun, Training},
    worker::stop_runs,
};
use self::{
    progress::Reporter,
    worker::{Failure, Shared},
};
use crate::{
    convert::errors::IntoPython,
    density::policy::{PolicyArgument, PythonPolicy},
};

/// Where a run begins, and where its checkpoints go.
struct Start {
    file: Option<PathBuf>,
    /// The state of an earlier run, which the file holds.
    checkpoint: Option<Checkpoint>,
}

impl Start {
    /// Reads the checkpoint that may be in a file.
    ///
    /// # Errors
    /// `OSError` for a damaged checkpoint, and for a path where none could be written.
    fn read(py: Python<'_>, file: Option<PathBuf>) -> PyResult<Self> {
        if let Some(path) = &file {
            let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty() && !folder.is_dir());
            let problem = match folder {
                Some(folder) => Some(format!("there is no folder {}; create it first", folder.display())),
                None => path.is_dir().then(|| format!("{} is a folder, but must be a file", path.display())),
            };
            if let Some(problem) = problem {
                return Err(PyOSError::new_err(format!("checkpoint: {problem}")));
            }
        }
        let checkpoint = match &file {
            Some(path) if path.is_file() => {
                Some(py.detach(|| gs_io::read_checkpoint(path)).map_err(IntoPython::into_python)?)
            }
            _ => None,
        };
        Ok(Self { file, checkpoint })
    }

    /// Steps that are done already.
    fn step(&self) -> u32 {
        let step = self.checkpoint.as_ref().and_then(|checkpoint| checkpoint.metadata.get("step"));
        step.and_then(|step| step.parse().ok()).unwrap_or(0)
    }
}

/// Runs a trainer to its end. If it is stopped, its checkpoint goes to the file, which is removed
/// when the run ends.
fn conduct<S: Trainable>(
    trainer: &mut Trainer<'_, AnyRasterizer, S>,
    reporter: &mut Reporter,
    checkpoint: Option<&Path>,
) -> Result<(), Failure>
where
    AnyRasterizer: gs_core::Optimizer<S>,
{
    if let Some(path) = checkpoint {
        reporter.keep_at(path);
    }
    let ended = block_on(trainer.run(reporter))?;
    match (ended, checkpoint) {
        (Outcome::Finished, Some(path)) if path.is_file() => {
            fs::remove_file(path).map_err(|error| Failure::Error(error.into()))
        }
        (Outcome::Finished, _) => Ok(()),
        (Outcome::Stopped, None) => Err(Failure::Stopped),
        (Outcome::Stopped, Some(path)) => {
            let checkpoint = block_on(trainer.saved())?;
            gs_io::write_checkpoint(path, &checkpoint)?;
            Err(Failure::Stopped)
        }
    }
}

/// The failure of a checkpoint that was made with other settings.
fn check_settings<T: PartialEq>(held: &T, wanted: &T) -> Result<(), Failure> {
    if held == wanted {
        return Ok(());
    }
    let problem = "the file is of a run with other settings; give these, or remove the file to start afresh";
    Err(Failure::Error(crate::convert::errors::value("checkpoint", problem)))
}

/// The policy of an object in Python, where it is one.
fn own_policy(
    policy: Option<PolicyArgument<'_>>,
    actions: Option<&gs_density::Actions>,
    shared: &Shared,
) -> PyResult<Option<Arc<PythonPolicy>>> {
    let Some(PolicyArgument::InPython(object)) = policy else { return Ok(None) };
    let actions = actions.copied().unwrap_or_default();
    PythonPolicy::new(&object, actions, shared.raised.clone()).map(Arc::new).map(Some)
}
