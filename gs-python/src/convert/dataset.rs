//! Data sets, read as a table of Python says.

use std::path::Path;

use gs_io::{WorldFrame, dataset::Dataset};
use gs_lab::study::DatasetReading;
use pyo3::{prelude::*, types::PyAny};

use super::{errors, settings};

/// Reads a data set, in the frame of a scene if there is one; `reading` has the keys of the table `[dataset]` of study files.
pub(crate) fn read_dataset(
    py: Python<'_>,
    path: &Path,
    reading: Option<&Bound<'_, PyAny>>,
    frame: Option<WorldFrame>,
) -> PyResult<Dataset> {
    let reading = settings::with("reading", DatasetReading::default(), reading)?;
    errors::computed(py, || reading.read(frame, path))
}
