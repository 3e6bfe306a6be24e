//! The Python module `gaussian_splats`: scenes as NumPy arrays, fits, trainings, renderings,
//! gradients, and density-control policies written in Python.
//!
//! Each Python class is one file here. What they do is documented in
//! `python/gaussian_splats/_native.pyi`, which editors and type checkers read, and from which
//! `build.rs` makes the docstrings.

include!(concat!(env!("OUT_DIR"), "/docstrings.rs"));

mod backend;
mod codec;
mod convert;
mod density;
mod gradients;
mod poses;
mod quality;
mod render;
mod run;
mod scene;
mod study;

// Results have the same bits on every system.
use gs_libm as _;
use pyo3::prelude::*;

/// What the linker exports: otherwise, Zig's exports everything, and nothing can be left out of the file.
#[cfg(all(windows, target_env = "gnu"))]
#[used]
#[expect(unsafe_code, reason = "the section is that of instructions for the linker")]
#[unsafe(link_section = ".drectve")]
static EXPORTS: [u8; 23] = *b" -export:PyInit__native";

/// The module as Python imports it.
#[pymodule]
mod _native {
    #[pymodule_export]
    use super::{
        backend::Backend,
        codec::{Encoded, decode, decode_image, encode},
        density::{observation::Observation, plan::Plan},
        gradients::{ForwardPass, forward},
        poses::poses,
        quality::{compare, evaluate, read_image, write_png},
        render::render,
        run::{Fit, FitRun, Progress, TrainRun, Training, stop_runs},
        scene::{
            camera::Camera,
            scene2d::Scene2d,
            scene3d::{Scene3d, load},
        },
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
        crate::convert::errors::computed(py, || -> Result<(), gs_core::Error> { panic!("on request") })
    }
}
