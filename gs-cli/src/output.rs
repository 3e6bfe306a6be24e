//! What the program says: results on standard output, everything else on standard error.

use std::{
    fmt::Display,
    io::{self, Write},
};

use serde::Serialize;

use crate::failure::Failure;

/// How a command prints its result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Format {
    /// For people.
    Text,
    /// One JSON object on standard output and nothing else there.
    Json,
}

/// Prints a result to standard output.
///
/// # Errors
/// Where it cannot be written; a closed pipe is the failure that is none.
pub(crate) fn result(text: impl Display) -> Result<(), Failure> {
    let mut stdout = io::stdout().lock();
    writeln!(stdout, "{text}").and_then(|()| stdout.flush()).map_err(Failure::output)
}

/// Prints a result as JSON to standard output. Numbers that JSON has no form for (∞, NaN) become `null`.
///
/// # Errors
/// As [`result`].
pub(crate) fn json(value: &impl Serialize) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(value).map_err(|error| Failure::failed(error).at("summary"))?;
    result(text)
}

/// Prints a line to standard error. Where nobody listens there, nothing is lost.
pub(crate) fn note(line: impl Display) {
    let _ = writeln!(io::stderr().lock(), "{line}");
}
