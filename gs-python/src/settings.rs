//! Settings as Python dictionaries, with the names of the settings files of `gs`.

use gs_lab::overrides;
use pyo3::{
    exceptions::PyValueError,
    prelude::*,
    types::{PyDict, PyString},
};
use serde::{Serialize, de::DeserializeOwned};
use toml::Table;

use crate::errors;

/// A dictionary as a table of settings.
///
/// # Errors
/// `ValueError` and `TypeError` for values that settings cannot have.
pub(crate) fn table(argument: &str, settings: &Bound<'_, PyAny>) -> PyResult<Table> {
    let py = settings.py();
    let strict = PyDict::new(py);
    strict.set_item("allow_nan", false)?;
    let text = py.import("json")?.call_method("dumps", (settings,), Some(&strict))?;
    let text: String = text.cast::<PyString>()?.extract()?;
    let value: serde_json::Value = serde_json::from_str(&text).map_err(|error| errors::value(argument, error))?;
    Table::try_from(value).map_err(|error| errors::value(argument, format!("not possible as settings: {error}")))
}

/// Settings with the values of a dictionary in place of their own.
///
/// # Errors
/// `ValueError` that names the unknown key or the impossible value.
pub(crate) fn with<T: Serialize + DeserializeOwned>(
    argument: &str,
    settings: T,
    over: Option<&Bound<'_, PyDict>>,
) -> PyResult<T> {
    match over {
        None => Ok(settings),
        Some(over) => {
            let over = table(argument, over.as_any())?;
            overrides::applied(&settings, &over).map_err(|problem| {
                let key = overrides::culprit(&over, |part| overrides::applied(&settings, part).is_ok());
                let place = [argument.to_owned()].into_iter().chain(key).collect::<Vec<_>>().join(".");
                errors::value(&place, problem)
            })
        }
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
