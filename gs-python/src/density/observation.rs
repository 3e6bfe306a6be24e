//! `Observation`: what a policy written in Python sees.

use bytemuck::cast_slice;
use gs_core::{Scene2d, Scene3d, constants::SH_C0};
use gs_density::{DensityScene, Residual};
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::{prelude::*, types::PyAny};

use crate::convert::arrays;

#[doc = doc!("Observation")]
#[pyclass(frozen, module = "gaussian_splats")]
#[derive(Debug, Default)]
pub(crate) struct Observation {
    len: usize,
    dimensions: usize,
    means: Vec<f32>,
    log_scales: Vec<f32>,
    rotations: Vec<f32>,
    opacity_logits: Vec<f32>,
    colors: Vec<f32>,
    signal: Vec<f32>,
    visible: Vec<u32>,
    residual: Option<Residual>,
    extent: f32,
    step: u32,
    progress: f32,
    budget: usize,
}

/// A kind of scene that Python sees the arrays of.
pub(crate) trait SeenScene: DensityScene {
    /// Copies the arrays into an observation. Of SH, only the colour without direction.
    fn copy_to(&self, seen: &mut Observation);
}

impl SeenScene for Scene2d {
    fn copy_to(&self, seen: &mut Observation) {
        seen.dimensions = 2;
        seen.means = cast_slice(&self.means).to_vec();
        seen.log_scales = cast_slice(&self.log_scales).to_vec();
        seen.rotations = self.rotations.clone();
        seen.opacity_logits = self.opacity_logits.clone();
        seen.colors = cast_slice(&self.colors).to_vec();
    }
}

impl SeenScene for Scene3d {
    fn copy_to(&self, seen: &mut Observation) {
        seen.dimensions = 3;
        seen.means = cast_slice(&self.means).to_vec();
        seen.log_scales = cast_slice(&self.log_scales).to_vec();
        seen.rotations = self.rotations.as_flattened().to_vec();
        seen.opacity_logits = self.opacity_logits.clone();
        let first = self.sh.iter().step_by(self.sh_len().max(1));
        seen.colors = first.flat_map(|c| (SH_C0 * *c + 0.5).to_array()).collect();
    }
}

impl Observation {
    pub(crate) fn of<S: SeenScene>(observation: &gs_density::Observation<'_, S>) -> Self {
        let gs_density::Observation { scene, statistics, residual, .. } = *observation;
        let len = scene.len();
        let mut seen = Self {
            len,
            signal: (0..len).map(|index| statistics.mean_signal(index)).collect(),
            visible: statistics.visible.clone(),
            residual: residual.cloned(),
            extent: observation.extent,
            step: observation.step,
            progress: observation.progress,
            budget: observation.budget,
            ..Self::default()
        };
        scene.copy_to(&mut seen);
        seen
    }

    fn array<'py>(this: &Bound<'py, Self>, values: &[f32], columns: usize) -> PyResult<Bound<'py, PyArray2<f32>>> {
        arrays::view(this.clone().into_any(), [this.get().len, columns], values)
    }
}

#[pymethods]
impl Observation {
    #[doc = doc!("Observation.means")]
    #[getter]
    fn means<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        Self::array(this, &this.get().means, this.get().dimensions)
    }

    #[doc = doc!("Observation.log_scales")]
    #[getter]
    fn log_scales<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        Self::array(this, &this.get().log_scales, this.get().dimensions)
    }

    #[doc = doc!("Observation.rotations")]
    #[getter]
    fn rotations(this: &Bound<'_, Self>) -> PyResult<Py<PyAny>> {
        let of = this.get();
        Ok(match of.dimensions {
            2 => arrays::view(this.clone().into_any(), [of.len], &of.rotations)?.into_any().unbind(),
            _ => Self::array(this, &of.rotations, 4)?.into_any().unbind(),
        })
    }

    #[doc = doc!("Observation.opacity_logits")]
    #[getter]
    fn opacity_logits<'py>(this: &Bound<'py, Self>) -> PyResult<Option<Bound<'py, PyArray1<f32>>>> {
        let of = this.get();
        if of.opacity_logits.len() != of.len {
            return Ok(None);
        }
        arrays::view(this.clone().into_any(), [of.len], &of.opacity_logits).map(Some)
    }

    #[doc = doc!("Observation.colors")]
    #[getter]
    fn colors<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        Self::array(this, &this.get().colors, 3)
    }

    #[doc = doc!("Observation.signal")]
    #[getter]
    fn signal<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray1<f32>>> {
        arrays::view(this.clone().into_any(), [this.get().len], &this.get().signal)
    }

    #[doc = doc!("Observation.visible")]
    #[getter]
    fn visible<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray1<u32>>> {
        arrays::view(this.clone().into_any(), [this.get().len], &this.get().visible)
    }

    #[doc = doc!("Observation.target")]
    #[getter]
    fn target<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray3<f32>>>> {
        self.residual.as_ref().map(|residual| arrays::of_image(py, &residual.target)).transpose()
    }

    #[doc = doc!("Observation.rendered")]
    #[getter]
    fn rendered<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray3<f32>>>> {
        self.residual.as_ref().map(|residual| arrays::of_image(py, &residual.rendered)).transpose()
    }

    #[doc = doc!("Observation.weights")]
    #[getter]
    fn weights<'py>(this: &Bound<'py, Self>) -> PyResult<Option<Bound<'py, PyArray2<f32>>>> {
        let residual = this.get().residual.as_ref();
        let weights = residual.and_then(|residual| residual.weights.as_deref().map(|weights| (residual, weights)));
        let view = |(residual, weights): (&Residual, &[f32])| {
            let (width, height) = residual.target.size();
            arrays::view(this.clone().into_any(), [height as usize, width as usize], weights)
        };
        weights.map(view).transpose()
    }

    #[doc = doc!("Observation.extent")]
    #[getter]
    fn extent(&self) -> f32 {
        self.extent
    }

    #[doc = doc!("Observation.step")]
    #[getter]
    fn step(&self) -> u32 {
        self.step
    }

    #[doc = doc!("Observation.progress")]
    #[getter]
    fn progress(&self) -> f32 {
        self.progress
    }

    #[doc = doc!("Observation.budget")]
    #[getter]
    fn budget(&self) -> usize {
        self.budget
    }

    fn __len__(&self) -> usize {
        self.len
    }

    fn __repr__(&self) -> String {
        format!("<Observation after step {}, {} of {} Gaussians>", self.step, self.len, self.budget)
    }
}
