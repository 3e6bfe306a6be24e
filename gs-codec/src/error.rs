//! Errors of reading and making files.

use std::ops::RangeInclusive;

use thiserror::Error;

/// Why bytes are not a `.gsi` file that can be decoded, or Gaussians cannot be stored as one.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// The bytes do not begin as a `.gsi` file does.
    #[error("is not a .gsi file: it does not begin with `GSIF`")]
    Magic,
    /// The file has a version, or uses a feature, that this program does not know.
    #[error("{what} {value} is not supported; a newer version of gs may read it")]
    Unsupported {
        /// What is not known.
        what: &'static str,
        /// Its value.
        value: u32,
    },
    /// The file ends too early.
    #[error("ends after {bytes} bytes, in the middle of {part} (truncated?)")]
    Truncated {
        /// Length of the file.
        bytes: usize,
        /// What is not complete.
        part: &'static str,
    },
    /// The checksum does not match.
    #[error("is corrupt: the checksum of layer {layer} does not match")]
    Checksum {
        /// The layer, counted from 1.
        layer: usize,
    },
    /// The colour profile is damaged.
    #[error("is corrupt: its colour profile cannot be decompressed")]
    Profile,
    /// A number of the file is impossible.
    #[error("is corrupt: {what} is {value}, but must be {allowed}")]
    Value {
        /// The number.
        what: &'static str,
        /// Its value.
        value: i64,
        /// The range in words.
        allowed: &'static str,
    },
    /// The Gaussians cannot be stored.
    #[error(transparent)]
    Core(#[from] gs_core::Error),
}

impl Error {
    /// [`Self::Value`] where `value` is not in `range`, which `allowed` says in words.
    pub(crate) fn within(
        what: &'static str,
        value: i64,
        range: RangeInclusive<i64>,
        allowed: &'static str,
    ) -> Result<(), Self> {
        if range.contains(&value) { Ok(()) } else { Err(Self::Value { what, value, allowed }) }
    }
}
