//! `Backend`: what computes.

use std::{
    process,
    sync::{Arc, Mutex, OnceLock, PoisonError},
};

use gs_backend::{AnyRasterizer, Chosen, Request, Wanted, block_on};
use gs_core::Choice as _;
use pyo3::{exceptions::PyRuntimeError, prelude::*};
use rayon::ThreadPoolBuilder;

use crate::convert::errors::{self, IntoPython};

/// A backend that is open in this process.
#[derive(Debug)]
pub(crate) struct Opened {
    chosen: Chosen,
    /// Number of threads of its own for what is not done by the backend, such as seeding; `None` for
    /// those that the whole process shares, which do not come along when a process is forked.
    own_threads: Option<usize>,
}

impl Opened {
    pub(crate) fn new(name: &str, threads: Option<usize>) -> PyResult<Self> {
        let wanted = Wanted::from_name(name).ok_or_else(|| {
            errors::value("backend", format!("{name:?} is not one of '{}'", Wanted::ALL.map(Wanted::name).join("', '")))
        })?;
        let request = Request::default().with(|request| {
            request.wanted = wanted;
            request.threads = threads;
        });
        let chosen = block_on(gs_backend::open(&request)).map_err(IntoPython::into_python)?;
        let own_threads = (is_forked() || threads.is_some()).then_some(chosen.threads);
        Ok(Self { chosen, own_threads })
    }

    pub(crate) fn rasterizer(&self) -> &AnyRasterizer {
        &self.chosen.rasterizer
    }

    /// Does work that needs threads besides those of the backend.
    ///
    /// A pool serves one piece of work: in a pool that several share, a thread that waits for the
    /// backend could begin another piece, and that would wait for the first one.
    pub(crate) fn within<T: Send, E: From<gs_core::Error> + Send>(
        &self,
        work: impl FnOnce(&AnyRasterizer) -> Result<T, E> + Send,
    ) -> Result<T, E> {
        let Some(threads) = self.own_threads else { return work(self.rasterizer()) };
        let pool = ThreadPoolBuilder::new().num_threads(threads).build();
        let pool = pool.map_err(|error| gs_core::Error::State(format!("cannot start threads: {error}")))?;
        pool.install(|| work(self.rasterizer()))
    }

    /// Does work of the backend without the interpreter's lock; see [`errors::computed`].
    pub(crate) fn compute<T: Send, E: IntoPython + Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&AnyRasterizer) -> Result<T, E> + Send,
    ) -> PyResult<T> {
        errors::computed(py, || work(self.rasterizer()))
    }

    /// Does work that also needs other threads without the interpreter's lock; see [`Self::within`].
    pub(crate) fn compute_within<T: Send, E: IntoPython + From<gs_core::Error> + Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&AnyRasterizer) -> Result<T, E> + Send,
    ) -> PyResult<T> {
        errors::computed(py, || self.within(work))
    }
}

/// The process that imported the module.
static ORIGIN: OnceLock<u32> = OnceLock::new();

/// Remembers which process this is.
pub(crate) fn remember_process() {
    ORIGIN.get_or_init(process::id);
}

/// Whether this process was forked after the module had been imported.
pub(crate) fn is_forked() -> bool {
    *ORIGIN.get_or_init(process::id) != process::id()
}

#[doc = doc!("Backend")]
#[pyclass(frozen, module = "gaussian_splats")]
#[derive(Debug)]
pub(crate) struct Backend {
    opened: Arc<Opened>,
    process: u32,
}

#[pymethods]
impl Backend {
    #[new]
    #[pyo3(signature = (name = "auto", *, threads = None))]
    fn new(py: Python<'_>, name: &str, threads: Option<usize>) -> PyResult<Self> {
        let opened = py.detach(|| Opened::new(name, threads))?;
        Ok(Self { opened: Arc::new(opened), process: process::id() })
    }

    #[doc = doc!("Backend.name")]
    #[getter]
    fn name(&self) -> &'static str {
        self.opened.rasterizer().name()
    }

    #[doc = doc!("Backend.reason")]
    #[getter]
    fn reason(&self) -> &str {
        &self.opened.chosen.reason
    }

    #[doc = doc!("Backend.threads")]
    #[getter]
    fn threads(&self) -> usize {
        self.opened.chosen.threads
    }

    fn __repr__(&self) -> String {
        format!("<Backend {}>", self.opened.chosen.reason)
    }
}

/// A backend that functions open by its name, and the process that opened it.
struct Shared {
    process: u32,
    name: String,
    opened: Arc<Opened>,
}

static SHARED: Mutex<Vec<Shared>> = Mutex::new(Vec::new());

/// The backend of an argument: one that is open, or the one of a name. Without an argument it is a
/// GPU if there is one, otherwise the CPU.
pub(crate) fn chosen(py: Python<'_>, backend: Option<&Bound<'_, PyAny>>) -> PyResult<Arc<Opened>> {
    let name = match backend {
        None => "auto".to_owned(),
        Some(backend) => {
            if let Ok(backend) = backend.cast::<Backend>() {
                return of_this_process(backend.get());
            }
            backend.extract::<String>().map_err(|_| errors::wrong_type("backend", "a Backend or a name", backend))?
        }
    };
    py.detach(|| {
        let process = process::id();
        let mut shared = SHARED.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(found) = shared.iter().find(|shared| shared.process == process && shared.name == name) {
            return Ok(found.opened.clone());
        }
        let opened = Arc::new(Opened::new(&name, None)?);
        // Those of the parent of a fork stay: to drop them would wait for threads that are not here.
        shared.push(Shared { process, name, opened: opened.clone() });
        Ok(opened)
    })
}

fn of_this_process(backend: &Backend) -> PyResult<Arc<Opened>> {
    if backend.process == process::id() {
        return Ok(backend.opened.clone());
    }
    let message = "backend: it was opened before this process was forked, and its threads did not come along; open a \
                   Backend in this process, or start processes by 'spawn'";
    Err(PyRuntimeError::new_err(message))
}
