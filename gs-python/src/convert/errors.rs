//! Rust errors as Python exceptions.

use std::{
    any::Any,
    fmt::Display,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{Arc, Mutex},
};

use pyo3::{
    exceptions::{PyOSError, PyRuntimeError, PyTypeError, PyValueError},
    prelude::*,
};

/// The exception that a policy has raised, for the thread that waits for the run.
pub(crate) type Raised = Arc<Mutex<Option<PyErr>>>;

/// An exception for an error of any of the crates: `OSError` for files, `ValueError` for settings
/// and values, `RuntimeError` for everything else.
pub(crate) trait IntoPython {
    fn into_python(self) -> PyErr;
}

impl IntoPython for gs_core::Error {
    fn into_python(self) -> PyErr {
        use gs_core::Error as E;
        match self {
            E::Backend { .. } | E::State(_) => PyRuntimeError::new_err(text(&self)),
            _ => PyValueError::new_err(text(&self)),
        }
    }
}

impl IntoPython for gs_io::Error {
    fn into_python(self) -> PyErr {
        PyOSError::new_err(text(&self))
    }
}

/// An operation on a scene, and why it cannot be done.
impl IntoPython for (&str, gs_io::EditError) {
    fn into_python(self) -> PyErr {
        match self {
            (_, gs_io::EditError::Read(error)) => error.into_python(),
            (operation, error) => value(operation, error),
        }
    }
}

impl IntoPython for gs_codec::Error {
    fn into_python(self) -> PyErr {
        PyValueError::new_err(format!("data: {}", text(&self)))
    }
}

impl IntoPython for gs_train::Error {
    fn into_python(self) -> PyErr {
        use gs_train::Error as E;
        match self {
            E::Io(error) => error.into_python(),
            E::Core(error) => error.into_python(),
            E::Edit(gs_io::EditError::Read(error)) => error.into_python(),
            E::Diverged { .. } | E::Finished { .. } => PyRuntimeError::new_err(text(&self)),
            _ => PyValueError::new_err(text(&self)),
        }
    }
}

impl IntoPython for gs_lab::Error {
    fn into_python(self) -> PyErr {
        match self {
            Self::Io(error) => error.into_python(),
            Self::Fit(error) => error.into_python(),
            Self::Jobs(error) => error.into_python(),
            Self::NotFound { .. } | Self::Path { .. } => PyOSError::new_err(text(&self)),
            _ => PyValueError::new_err(text(&self)),
        }
    }
}

impl IntoPython for gs_jobs::Error {
    fn into_python(self) -> PyErr {
        match self {
            Self::Work { .. } => PyValueError::new_err(text(&self)),
            _ => PyOSError::new_err(text(&self)),
        }
    }
}

impl IntoPython for gs_poses::Error {
    fn into_python(self) -> PyErr {
        use gs_poses::Error as E;
        match self {
            E::Io(error) => error.into_python(),
            E::NotAFolder { .. } | E::Path { .. } | E::HasPoses { .. } => PyOSError::new_err(text(&self)),
            E::TooFew { .. } | E::Video { .. } => PyValueError::new_err(text(&self)),
            _ => PyRuntimeError::new_err(text(&self)),
        }
    }
}

/// An error with what caused it.
fn text(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(cause) = source {
        let cause_text = cause.to_string();
        if !text.contains(&cause_text) {
            text.push_str(": ");
            text.push_str(&cause_text);
        }
        source = cause.source();
    }
    text
}

/// A `ValueError` about an argument.
pub(crate) fn value(argument: &str, problem: impl Display) -> PyErr {
    PyValueError::new_err(format!("{argument}: {problem}"))
}

/// A `TypeError` about an argument that is of another type.
pub(crate) fn wrong_type(argument: &str, expected: impl Display, found: &Bound<'_, PyAny>) -> PyErr {
    PyTypeError::new_err(format!("{argument}: expected {expected}, not {}", type_name(found)))
}

/// The name of an object's type.
pub(crate) fn type_name(object: &Bound<'_, PyAny>) -> String {
    object.get_type().name().map_or_else(|_| "something else".to_owned(), |name| name.to_string())
}

/// A `RuntimeError` for a panic of the engine, which is a fault of ours.
pub(crate) fn of_panic(panic: &(dyn Any + Send)) -> PyErr {
    let message = panic.downcast_ref::<String>().map(String::as_str);
    let message = message.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("without a message");
    PyRuntimeError::new_err(format!("the engine failed ({message}); please report this"))
}

/// Computes without the interpreter's lock.
///
/// # Errors
/// The error of the work as an exception; a `RuntimeError` where it panics.
pub(crate) fn computed<T: Send, E: IntoPython + Send>(
    py: Python<'_>,
    work: impl FnOnce() -> Result<T, E> + Send,
) -> PyResult<T> {
    match py.detach(|| catch_unwind(AssertUnwindSafe(work))) {
        Ok(done) => done.map_err(IntoPython::into_python),
        Err(panic) => Err(of_panic(&*panic)),
    }
}
