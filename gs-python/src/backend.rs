//! `Backend`: what computes.

use std::{
    process,
    sync::{Arc, Mutex, PoisonError},
};

use gs_backend::{AnyRasterizer, Chosen, Request, Wanted, block_on};
use pyo3::{
    exceptions::{PyRuntimeError, PyValueError},
    prelude::*,
};

use crate::errors::IntoPython;

/// A backend that is ready to compute.
#[pyclass(frozen, module = "gaussian_splats")]
#[derive(Debug)]
pub(crate) struct Backend {
    chosen: Arc<Chosen>,
    process: u32,
}

/// The backend that functions use where none is given, and the process that opened it.
static DEFAULT: Mutex<Option<(u32, Arc<Chosen>)>> = Mutex::new(None);

#[pymethods]
impl Backend {
    #[new]
    #[pyo3(signature = (name = "auto", *, threads = None))]
    fn new(py: Python<'_>, name: &str, threads: Option<usize>) -> PyResult<Self> {
        let chosen = py.detach(|| open(name, threads))?;
        Ok(Self { chosen: Arc::new(chosen), process: process::id() })
    }

    /// "cpu" or "wgpu".
    #[getter]
    fn name(&self) -> &'static str {
        self.chosen.rasterizer.name()
    }

    /// What was chosen and why.
    #[getter]
    fn reason(&self) -> &str {
        &self.chosen.reason
    }

    /// Threads on the host.
    #[getter]
    fn threads(&self) -> usize {
        self.chosen.threads
    }

    fn __repr__(&self) -> String {
        format!("<Backend {}>", self.chosen.reason)
    }
}

fn open(name: &str, threads: Option<usize>) -> PyResult<Chosen> {
    let wanted = match name {
        "auto" => Wanted::Fastest,
        "cpu" => Wanted::Cpu,
        "wgpu" => Wanted::Wgpu,
        _ => return Err(PyValueError::new_err(format!("name: {name:?} is not one of 'auto', 'cpu', 'wgpu'"))),
    };
    let request = Request::default().with(|request| {
        request.wanted = wanted;
        request.threads = threads;
    });
    block_on(gs_backend::open(&request)).map_err(IntoPython::into_python)
}

/// The given backend, or the default one: a GPU if there is one, otherwise the CPU.
pub(crate) fn chosen(py: Python<'_>, backend: Option<&Bound<'_, Backend>>) -> PyResult<Arc<Chosen>> {
    let id = process::id();
    if let Some(backend) = backend.map(Bound::get) {
        if backend.process != id {
            let message = "backend: it was opened before this process was forked, and its threads did not come along; \
                           open a Backend in this process, or start processes by 'spawn'";
            return Err(PyRuntimeError::new_err(message));
        }
        return Ok(backend.chosen.clone());
    }
    py.detach(|| {
        let mut default = DEFAULT.lock().unwrap_or_else(PoisonError::into_inner);
        match &*default {
            Some((process, chosen)) if *process == id => Ok(chosen.clone()),
            other => {
                // The threads of the parent's backend are not here, so dropping it would wait for
                // them for ever.
                if other.is_some() {
                    std::mem::forget(default.take());
                }
                let chosen = Arc::new(open("auto", None)?);
                *default = Some((id, chosen.clone()));
                Ok(chosen)
            }
        }
    })
}

/// The rasterizer of a backend.
pub(crate) fn rasterizer(chosen: &Chosen) -> &AnyRasterizer {
    &chosen.rasterizer
}
