//! Settings as mappings of Python or as files, with the names of the settings files of `gs`.

use std::{
    fmt::Display,
    fs,
    path::{Path, PathBuf},
};

use gs_lab::study::overrides;
use gs_train::SettingsFile;
use pyo3::{
    exceptions::{PyOSError, PyValueError},
    prelude::*,
    types::{PyDict, PyMapping, PyString},
};
use serde::{Serialize, de::DeserializeOwned};
use toml::Table;

use super::errors;

/// The settings that a run starts from, as its arguments give them.
pub(crate) enum Given<'py> {
    /// A preset, and changes to it.
    Preset { name: String, changes: Option<Bound<'py, PyAny>> },
    /// A file with all settings.
    File(PathBuf),
}

impl<'py> Given<'py> {
    /// What `preset` and `settings` say.
    pub(crate) fn of(argument: &str, preset: Option<&str>, settings: Option<&Bound<'py, PyAny>>) -> PyResult<Self> {
        let file = settings.and_then(|settings| settings.extract::<PathBuf>().ok());
        match (file, preset) {
            (Some(_), Some(_)) => Err(errors::value("preset", format!("the file of {argument} has all settings"))),
            (Some(file), None) => Ok(Self::File(file)),
            (None, preset) => {
                Ok(Self::Preset { name: preset.unwrap_or("standard").to_owned(), changes: settings.cloned() })
            }
        }
    }
}

/// The text of a settings file.
pub(crate) fn text_of(file: &Path) -> PyResult<String> {
    let failed = |error: &dyn Display| PyOSError::new_err(format!("cannot read {}: {error}", file.display()));
    let bytes = fs::read(file).map_err(|error| failed(&error))?;
    let text = gs_io::utf8_text(file, &bytes).map_err(|error| PyOSError::new_err(error.to_string()))?;
    str::from_utf8(text).map(str::to_owned).map_err(|error| failed(&error))
}

/// A mapping as a table of settings. Numbers and arrays of NumPy become those of Python.
///
/// # Errors
/// `ValueError` and `TypeError` for values that settings cannot have.
fn table(argument: &str, settings: &Bound<'_, PyAny>) -> PyResult<Table> {
    let py = settings.py();
    if settings.cast::<PyMapping>().is_err() {
        return Err(errors::wrong_type(argument, "a mapping", settings));
    }
    let options = PyDict::new(py);
    options.set_item("allow_nan", false)?;
    options.set_item("default", py.import("operator")?.call_method1("methodcaller", ("tolist",))?)?;
    let settings = PyDict::from_sequence(&settings.call_method0("items")?)?;
    let text = py.import("json")?.call_method("dumps", (settings,), Some(&options));
    let text = text.map_err(|error| errors::value(argument, format!("not possible as settings: {error}")))?;
    let text: String = text.cast::<PyString>()?.extract()?;
    let value: serde_json::Value = serde_json::from_str(&text).map_err(|error| errors::value(argument, error))?;
    if let Some(key) = key_of_none(&value) {
        return Err(errors::value(&format!("{argument}{key}"), "a setting cannot be None; omit the key"));
    }
    Table::try_from(value).map_err(|error| errors::value(argument, format!("not possible as settings: {error}")))
}

/// Where a None is in settings, such as `.adam.mean`.
fn key_of_none(value: &serde_json::Value) -> Option<String> {
    match value {
        serde_json::Value::Null => Some(String::new()),
        serde_json::Value::Object(of) => {
            of.iter().find_map(|(key, value)| key_of_none(value).map(|rest| format!(".{key}{rest}")))
        }
        serde_json::Value::Array(of) => {
            of.iter().enumerate().find_map(|(index, value)| key_of_none(value).map(|rest| format!("[{index}]{rest}")))
        }
        _ => None,
    }
}

/// Settings with the values of a mapping in place of their own.
///
/// # Errors
/// `ValueError` that names the unknown key or the impossible value.
pub(crate) fn with<T: SettingsFile>(argument: &str, settings: T, over: Option<&Bound<'_, PyAny>>) -> PyResult<T> {
    match over {
        None => Ok(settings),
        Some(over) => {
            let over = table(argument, over)?;
            overrides::applied(&settings, &over).map_err(|problem| errors::value(argument, problem))
        }
    }
}

/// Settings with the rounds of density control of a mapping. Call this before a policy is chosen,
/// because some policies depend on the rounds. Rounds that are not possible are ignored here;
/// [`with`] reports them.
///
/// # Errors
/// `ValueError` if the argument is not a mapping of settings.
pub(crate) fn with_rounds<T: SettingsFile>(
    argument: &str,
    settings: T,
    over: Option<&Bound<'_, PyAny>>,
) -> PyResult<T> {
    match over {
        None => Ok(settings),
        Some(over) => Ok(overrides::with_rounds(settings, &table(argument, over)?)),
    }
}

/// A Rust value as Python objects: dictionaries, lists, numbers and strings.
pub(crate) fn to_python<'py>(py: Python<'py>, value: &impl Serialize) -> PyResult<Bound<'py, PyAny>> {
    let text = serde_json::to_string(value).map_err(|error| PyValueError::new_err(error.to_string()))?;
    py.import("json")?.call_method1("loads", (text,))
}

/// A value by its name in settings files.
pub(crate) fn named<T: DeserializeOwned>(argument: &str, name: &str) -> PyResult<T> {
    serde_json::from_value(serde_json::Value::from(name)).map_err(|error| errors::value(argument, error))
}
