//! Files of settings: read, and written.

use std::path::Path;

use gs_train::{parse_settings, settings_to_toml};
use serde::{Serialize, de::DeserializeOwned};

use crate::{failure::Failure, text_file::read_text};

/// What helps where there is no file of settings.
const MEND_FILE: &str = "name a file of settings";

/// The text of a file of settings. It is read once: it may be a pipe.
///
/// # Errors
/// Where it cannot be read.
pub(crate) fn read_settings_text(file: &Path) -> Result<String, Failure> {
    read_text(file, MEND_FILE)
}

/// Reads a file of settings of any kind; `mend` is what helps where its content is wrong.
///
/// # Errors
/// Where it cannot be read, or is not of this kind.
pub(crate) fn read_toml<T: DeserializeOwned>(file: &Path, mend: &str) -> Result<T, Failure> {
    parse_toml(&read_settings_text(file)?, file, mend)
}

/// The same of the text of a file that was read.
///
/// # Errors
/// Where it is not of this kind.
pub(crate) fn parse_toml<T: DeserializeOwned>(text: &str, file: &Path, mend: &str) -> Result<T, Failure> {
    parse_settings(text, file).map_err(|error| Failure::usage(error).mend(mend))
}

/// The settings as TOML, for [`read_toml`] to read.
///
/// # Errors
/// Where they cannot be written as TOML.
pub(crate) fn to_toml(settings: &impl Serialize) -> Result<String, Failure> {
    settings_to_toml(settings).map_err(Failure::failed)
}
