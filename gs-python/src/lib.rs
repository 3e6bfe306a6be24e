//! The Python module `gaussian_splats`: scenes as NumPy arrays, fits, trainings, renderings,
//! gradients, and density-control policies written in Python.
//!
//! Each Python class is one file here. What they do is documented in
//! `python/gaussian_splats/_native.pyi`, which editors and type checkers read, and from which
//! `build.rs` makes the docstrings.

include!(concat!(env!("OUT_DIR"), "/docstrings.rs"));

mod arrays;
mod backend;
mod camera;
mod codec;
mod errors;
mod gradients;
mod notebook;
mod observation;
mod oracle;
mod plan;
mod policy;
mod quality;
mod render;
mod run;
mod scene2d;
mod scene3d;
mod settings;
mod study;

use pyo3::prelude::*;

/// The module as Python imports it.
#[pymodule]
mod _native {
    #[pymodule_export]
    use super::{
        backend::Backend,
        camera::Camera,
        codec::{Encoded, decode, decode_image, encode},
        gradients::{ForwardPass, forward},
        observation::Observation,
        oracle::{oracle_gradient, oracle_render},
        plan::Plan,
        quality::{compare, evaluate, read_image, write_png},
        render::render,
        run::{Fit, FitRun, Progress, TrainRun, Training, stop_runs},
        scene2d::Scene2d,
        scene3d::{Scene3d, load},
        study::Study,
    };
    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(_module: &Bound<'_, PyModule>) -> PyResult<()> {
        crate::backend::remember_process();
        Ok(())
    }

    /// Panics, for a test.
    #[cfg(debug_assertions)]
    #[pyfunction(name = "_panic")]
    fn panic(py: Python<'_>) -> PyResult<()> {
        crate::errors::computed(py, || -> Result<(), gs_core::Error> { panic!("on request") })
    }
}
