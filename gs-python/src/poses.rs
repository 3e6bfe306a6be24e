//! `poses`: camera poses of photographs or a video, by COLMAP or PyCOLMAP.

use std::{cell::RefCell, path::PathBuf};

use gs_io::FolderClaim;
use gs_poses::{Colmap, FILES, Input, Reporter, Settings, Stage, find_poses, refuse_other_models};
use pyo3::prelude::*;

use crate::convert::{errors, settings};

/// Reports to Python, and ends the work where Python raises.
#[derive(Default)]
struct Reports {
    progress: Option<Py<PyAny>>,
    raised: RefCell<Option<PyErr>>,
}

impl Reports {
    /// Keeps the first exception.
    fn keep(&self, result: PyResult<()>) {
        if let Err(error) = result {
            self.raised.borrow_mut().get_or_insert(error);
        }
    }
}

impl Reporter for Reports {
    fn progress(&mut self, stage: Stage, done: usize, total: usize) {
        let Some(progress) = &self.progress else { return };
        self.keep(Python::attach(|py| progress.call1(py, (stage.words(), done, total)).map(drop)));
    }

    fn note(&mut self, line: &str) {
        let warn = |py: Python<'_>| py.import("warnings")?.call_method1("warn", (line,)).map(drop);
        self.keep(Python::attach(warn));
    }

    fn is_cancelled(&self) -> bool {
        self.keep(Python::attach(|py| py.check_signals()));
        self.raised.borrow().is_some()
    }
}

#[doc = doc!("poses")]
#[allow(clippy::too_many_arguments, reason = "keyword arguments")]
#[pyfunction]
#[pyo3(signature = (
    photos, output, *, lens = "auto", pairs = "auto", max_size = None, vocabulary = None, threads = None,
    resume = false, overwrite = false, progress = None
))]
pub(crate) fn poses<'py>(
    py: Python<'py>,
    photos: PathBuf,
    output: PathBuf,
    lens: &str,
    pairs: &str,
    max_size: Option<u32>,
    vocabulary: Option<PathBuf>,
    threads: Option<u32>,
    resume: bool,
    overwrite: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let (lens, pairs) = (settings::named("lens", lens)?, settings::named("pairs", pairs)?);
    let chosen = Settings::default().with(|s| {
        (s.lens, s.pairs, s.vocabulary, s.threads) = (lens, pairs, vocabulary, threads);
        s.max_size = max_size.unwrap_or(s.max_size);
    });
    if chosen.max_size < 100 {
        return Err(errors::value("max_size", "at least 100 px"));
    }
    if threads == Some(0) {
        return Err(errors::value("threads", "at least 1"));
    }
    let python: PathBuf = py.import("sys")?.getattr("executable")?.extract()?;
    let mut reports = Reports { progress, ..Reports::default() };
    let found = errors::computed(py, || {
        let input = Input::find(&photos)?;
        let colmap = Colmap::find_or(python)?;
        let inputs = input.paths().into_iter().collect();
        let claim = FolderClaim { inputs, overwrite, ..FolderClaim::new(&output, FILES) };
        claim.check()?;
        refuse_other_models(&output)?;
        let folder = claim.begin()?;
        let found = find_poses(&input, &chosen, &colmap, (&folder, resume), &mut reports);
        Ok::<_, gs_poses::Error>((found, reports.raised.into_inner()))
    });
    match found? {
        (_, Some(raised)) => Err(raised),
        (found, None) => settings::to_python(py, &found.map_err(errors::IntoPython::into_python)?),
    }
}
