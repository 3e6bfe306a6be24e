//! `Progress`: what a run reports after each step, and the history of all of it.

use std::{
    path::{Path, PathBuf},
    sync::{Arc, atomic::Ordering::Relaxed, mpsc::Sender},
    time::{Duration, Instant},
};

use gs_core::SavedState;
use gs_io::Checkpoint;
use gs_train::{Control, Observer};
use numpy::PyArray1;
use pyo3::{prelude::*, types::PyDict};

use super::worker::Shared;

/// Time between two checkpoints, where there is a file for them.
const CHECKPOINTS: Duration = Duration::from_secs(120);

#[doc = doc!("Progress")]
#[pyclass(frozen, module = "gaussian_splats", get_all)]
#[derive(Debug)]
pub(crate) struct Progress {
    #[doc = doc!("Progress.step")]
    step: u32,
    #[doc = doc!("Progress.iterations")]
    iterations: u32,
    #[doc = doc!("Progress.seconds")]
    seconds: f64,
    #[doc = doc!("Progress.count")]
    count: u32,
    #[doc = doc!("Progress.loss")]
    loss: f32,
    #[doc = doc!("Progress.psnr")]
    psnr: Option<f64>,
    #[doc = doc!("Progress.edits")]
    edits: Option<(u32, u32, u32, u32)>,
}

#[pymethods]
impl Progress {
    fn __repr__(&self) -> String {
        let Self { step, iterations, count, loss, .. } = self;
        format!("<Progress: step {step} of {iterations}, {count} Gaussians, loss {loss:.4e}>")
    }
}

/// The numbers of all steps.
#[derive(Debug, Default)]
pub(crate) struct History {
    step: Vec<u32>,
    seconds: Vec<f64>,
    count: Vec<u32>,
    loss: Vec<f32>,
    /// NaN where it is not known.
    psnr: Vec<f64>,
}

impl History {
    fn push(&mut self, progress: &gs_train::Progress) {
        self.step.push(progress.step);
        self.seconds.push(progress.seconds);
        self.count.push(progress.count);
        self.loss.push(progress.loss);
        self.psnr.push(progress.psnr().unwrap_or(f64::NAN));
    }

    /// As arrays by name.
    pub(super) fn to_python<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let arrays = PyDict::new(py);
        arrays.set_item("step", PyArray1::from_slice(py, &self.step))?;
        arrays.set_item("seconds", PyArray1::from_slice(py, &self.seconds))?;
        arrays.set_item("count", PyArray1::from_slice(py, &self.count))?;
        arrays.set_item("loss", PyArray1::from_slice(py, &self.loss))?;
        arrays.set_item("psnr", PyArray1::from_slice(py, &self.psnr))?;
        Ok(arrays)
    }
}

/// Reports to Python, stops the run where Python wants that, and writes checkpoints.
pub(super) struct Reporter {
    pub(super) shared: Arc<Shared>,
    sender: Sender<Progress>,
    history: History,
    checkpoint: Option<PathBuf>,
    last_checkpoint: Instant,
}

impl Reporter {
    pub(super) fn new(shared: Arc<Shared>, sender: Sender<Progress>) -> Self {
        Self { shared, sender, history: History::default(), checkpoint: None, last_checkpoint: Instant::now() }
    }

    /// Writes checkpoints to this file from now on.
    pub(super) fn keep_at(&mut self, checkpoint: &Path) {
        self.checkpoint = Some(checkpoint.to_owned());
        self.last_checkpoint = Instant::now();
    }

    /// Ends the reports.
    pub(super) fn history(self) -> History {
        self.history
    }
}

impl Observer for Reporter {
    fn on_step(&mut self, progress: &gs_train::Progress) -> Control {
        self.history.push(progress);
        let report = Progress {
            step: progress.step,
            iterations: progress.iterations,
            seconds: progress.seconds,
            count: progress.count,
            loss: progress.loss,
            psnr: progress.psnr(),
            edits: progress.edits.map(|edits| (edits.cloned, edits.split, edits.seeded, edits.pruned())),
        };
        // Nobody listens after the run has been dropped.
        let _ = self.sender.send(report);
        if self.shared.stops.load(Relaxed) { Control::Stop } else { Control::Continue }
    }

    fn wants_checkpoint(&mut self, _: &gs_train::Progress) -> bool {
        self.checkpoint.is_some() && self.last_checkpoint.elapsed() >= CHECKPOINTS
    }

    fn on_checkpoint(&mut self, checkpoint: &mut Checkpoint<SavedState<'_>>) -> Result<(), gs_train::Error> {
        if let Some(path) = &self.checkpoint {
            gs_io::write_checkpoint(path, checkpoint)?;
        }
        self.last_checkpoint = Instant::now();
        Ok(())
    }
}
