//! Which views are for training and which are held out.

use std::{fmt, num::NonZeroU32};

use serde::Serialize;

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
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum SplitOrigin {
    /// Lists: `train_filenames` and its like, `test_frames`, `train_test_lists.json` or `test.txt`.
    Lists,
    /// Separate files: `transforms_train.json`, `transforms_test.json`.
    Files,
    /// The data set has no split, and every n-th image by name is held out
    /// ([`DatasetSettings::test_every`](super::DatasetSettings::test_every)).
    Every(NonZeroU32),
    /// The data set has no split, and no view is held out.
    None,
    /// Every n-th image by name, or none, is held out in place of the data set's own split
    /// ([`DatasetSettings::replace_split`](super::DatasetSettings::replace_split)).
    Replaced(Option<NonZeroU32>),
}

impl fmt::Display for SplitOrigin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Lists => f.write_str("lists of the data set"),
            Self::Files => f.write_str("separate files of the data set"),
            Self::Every(every) => write!(f, "1 of {every} images by name held out: the data set states no split"),
            Self::Replaced(Some(every)) => {
                write!(f, "1 of {every} images by name held out, in place of the data set's split")
            }
            Self::Replaced(None) => f.write_str("no view held out, in place of the data set's split"),
            Self::None => f.write_str("no view held out: the data set states no split"),
        }
    }
}
