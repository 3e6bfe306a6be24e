//! The Python module `gaussian_splats`: scenes as NumPy arrays, fits, trainings, renderings,
//! gradients, and density-control policies written in Python.
//!
//! Each Python class is one file here. What they do is documented in
//! `python/gaussian_splats/_native.pyi`, which editors and type checkers read.

mod arrays;
mod backend;
mod camera;
mod errors;
mod gradients;
mod observation;
mod plan;
mod policy;
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
        gradients::ForwardPass,
        observation::Observation,
        plan::Plan,
        render::{compare, read_image, render, write_png},
        run::{Fit, FitRun, Progress, TrainRun, Training},
        scene2d::Scene2d,
        scene3d::Scene3d,
        scene3d::load,
        study::Study,
    };
    #[allow(unused_imports, reason = "the macro needs it")]
    use pyo3::prelude::*;
}
