//! The clock of a study: what its tables and its comparisons at equal time call time.

use cpu_time::ProcessTime;
use std::time::Duration;

use gs_core::Optimizer;
use gs_train::{Error as TrainError, Trainable, Trainer};
use serde::{Deserialize, Serialize};

use crate::error::Error;

/// What a study measures as the time of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Clock {
    /// The time that passes. Other programs on the machine make it longer.
    #[default]
    Wall,
    /// The CPU time of the process, summed over its threads. Other programs change it little, so
    /// it is for machines that are shared. A process does one run at a time on the cpu backend.
    Cpu,
}

impl Clock {
    /// Whether this is the clock of a study that names none.
    pub(crate) fn is_wall(&self) -> bool {
        *self == Self::Wall
    }

    /// The unit of times in tables and figures.
    pub(crate) const fn unit(self) -> &'static str {
        match self {
            Self::Wall => "s",
            Self::Cpu => "CPU s",
        }
    }

    /// Begins a run whose training time this clock measures, from its initialization on.
    pub(crate) fn begin<'r, R: Optimizer<S>, S: Trainable>(
        self,
        begin: impl FnOnce() -> Result<Trainer<'r, R, S>, TrainError>,
    ) -> Result<Trainer<'r, R, S>, TrainError> {
        match self {
            Self::Wall => begin(),
            Self::Cpu => {
                let started = cpu_time();
                let trainer = begin()?;
                Ok(trainer.timed_by(cpu_time, (cpu_time() - started).as_secs_f64()))
            }
        }
    }

    /// The run from a checkpoint, whose training time goes on with this clock.
    pub(crate) fn go_on<'r, R: Optimizer<S>, S: Trainable>(self, trainer: Trainer<'r, R, S>) -> Trainer<'r, R, S> {
        match self {
            Self::Wall => trainer,
            Self::Cpu => {
                let seconds = trainer.seconds();
                trainer.timed_by(cpu_time, seconds)
            }
        }
    }

    /// Fails where several runs of a process would share the clock.
    ///
    /// # Errors
    /// [`Error::Work`].
    pub(crate) fn check_team(self, side_by_side: usize) -> Result<(), Error> {
        match self {
            Self::Cpu if side_by_side > 1 => Err(Error::Work {
                message: format!(
                    "{side_by_side} runs side by side in one process share its CPU time, which is this study's clock: \
                     leave out --jobs, and start several processes instead"
                ),
            }),
            _ => Ok(()),
        }
    }
}

/// CPU time of this process so far.
fn cpu_time() -> Duration {
    ProcessTime::now().as_duration()
}
