//! What a trial found and decided, as in summaries and checkpoints.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::{
    error::Error,
    run::{table, to_table},
    train::settings::TrainSettings,
};

/// Key in the metadata of checkpoints.
const KEY: &str = "trial";

/// What a trial found before the run, and what was decided by it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub struct TrialReport {
    /// Number of steps of the trial.
    pub steps: u32,
    /// Number of training views that it left out.
    pub left_out: usize,
    /// Time that it took, s.
    pub seconds: f64,
    /// PSNR of the views left out in the last third of its measurements above that before, each the best one, dB.
    pub gain_db: f64,
    /// Number of steps of the run that was decided.
    pub iterations: u32,
    /// Largest number of Gaussians of the run, where the trial decided it: that with the best measurement where more
    /// harm, and otherwise twice the number before where the run is lengthened.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gaussians: Option<u32>,
}

/// A trial that has been made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub(in crate::train) struct Trial {
    pub(in crate::train) report: TrialReport,
    /// The settings of the run before the trial changed them: with these, the run is repeated.
    pub(in crate::train) given: TrainSettings,
}

impl Trial {
    /// That of a checkpoint with this metadata, if any.
    ///
    /// # Errors
    /// [`Error::Checkpoint`] where it cannot be read.
    pub(in crate::train) fn from_metadata(metadata: &BTreeMap<String, String>) -> Result<Option<Self>, Error> {
        metadata.contains_key(KEY).then(|| table(metadata, KEY)).transpose()
    }

    /// The metadata for a checkpoint.
    ///
    /// # Errors
    /// [`Error::Checkpoint`] where TOML has no form for it.
    pub(in crate::train) fn to_metadata(&self) -> Result<(&'static str, String), Error> {
        Ok((KEY, to_table(KEY, self)?))
    }
}
