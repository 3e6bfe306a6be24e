//! Which views are for training and which are held out.

use std::num::NonZeroU32;

use serde::Serialize;
use thiserror::Error;

/// The purpose of a view.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Split {
    /// Training.
    Train,
    /// Choosing settings: Blender's `transforms_val.json`.
    Validation,
    /// Evaluation only.
    Test,
}

/// Where the split of a data set comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum SplitOrigin {
    /// Lists: `train_filenames` and its like, `test_frames`, `train_test_lists.json` or `test.txt`.
    #[error("lists of the data set")]
    Lists,
    /// Separate files: `transforms_train.json`, `transforms_test.json`.
    #[error("separate files of the data set")]
    Files,
    /// The data set has no split, and every n-th image by name is held out
    /// ([`DatasetSettings::test_every`](super::DatasetSettings::test_every)).
    #[error("1 of {0} images by name held out: the data set states no split")]
    Every(NonZeroU32),
    /// The data set has no split, and no view is held out.
    #[error("no view held out: the data set states no split")]
    None,
    /// Every n-th image by name, or none, is held out in place of the data set's own split
    /// ([`DatasetSettings::replace_split`](super::DatasetSettings::replace_split)).
    #[error("{}, in place of the data set's split", held_out(*.0))]
    Replaced(Option<NonZeroU32>),
}

fn held_out(every: Option<NonZeroU32>) -> String {
    every.map_or_else(|| "no view held out".to_owned(), |every| format!("1 of {every} images by name held out"))
}
