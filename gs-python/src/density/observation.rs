//! `Observation`: what a policy written in Python sees.

use bytemuck::cast_slice;
use gs_core::{Image, Scene2d, Scene3d, constants::SH_C0};
use gs_density::DensityScene;
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods as _, PyUntypedArrayMethods as _};
use pyo3::{prelude::*, types::PyAny};

use crate::convert::arrays::{of_image, owned, readonly};

#[doc = doc!("Observation")]
#[pyclass(frozen, module = "gaussian_splats", get_all)]
#[derive(Debug)]
pub(crate) struct Observation {
    #[doc = doc!("Observation.means")]
    means: Py<PyAny>,
    #[doc = doc!("Observation.log_scales")]
    log_scales: Py<PyAny>,
    #[doc = doc!("Observation.rotations")]
    rotations: Py<PyAny>,
    #[doc = doc!("Observation.opacity_logits")]
    opacity_logits: Option<Py<PyArray1<f32>>>,
    #[doc = doc!("Observation.colors")]
    colors: Py<PyAny>,
    #[doc = doc!("Observation.signal")]
    signal: Py<PyArray1<f32>>,
    #[doc = doc!("Observation.visible")]
    visible: Py<PyArray1<u32>>,
    #[doc = doc!("Observation.target")]
    target: Option<Py<PyArray3<f32>>>,
    #[doc = doc!("Observation.rendered")]
    rendered: Option<Py<PyArray3<f32>>>,
    #[doc = doc!("Observation.weights")]
    weights: Option<Py<PyArray2<f32>>>,
    #[doc = doc!("Observation.extent")]
    extent: f32,
    #[doc = doc!("Observation.step")]
    step: u32,
    #[doc = doc!("Observation.progress")]
    progress: f32,
    #[doc = doc!("Observation.budget")]
    budget: usize,
}

/// A kind of scene that Python sees the arrays of.
pub(crate) trait SeenScene: DensityScene {
    /// Arrays of means, log-scales, rotations and colours. Of SH, only the colour without direction.
    fn arrays(&self, py: Python<'_>) -> PyResult<[Py<PyAny>; 4]>;

    /// The logits of opacities; none where Gaussians have no opacity.
    fn opacity_logits(&self) -> &[f32];
}

impl SeenScene for Scene2d {
    fn arrays(&self, py: Python<'_>) -> PyResult<[Py<PyAny>; 4]> {
        let rotations = owned(py, self.rotations.clone(), [self.rotations.len()])?;
        Ok([
            table(py, cast_slice(&self.means), 2)?,
            table(py, cast_slice(&self.log_scales), 2)?,
            rotations.into_any().unbind(),
            table(py, cast_slice(&self.colors), 3)?,
        ])
    }

    fn opacity_logits(&self) -> &[f32] {
        &self.opacity_logits
    }
}

impl SeenScene for Scene3d {
    fn arrays(&self, py: Python<'_>) -> PyResult<[Py<PyAny>; 4]> {
        let first = self.sh.iter().step_by(self.sh_len().max(1));
        let colors: Vec<f32> = first.flat_map(|c| (SH_C0 * *c + 0.5).to_array()).collect();
        Ok([
            table(py, cast_slice(&self.means), 3)?,
            table(py, cast_slice(&self.log_scales), 3)?,
            table(py, self.rotations.as_flattened(), 4)?,
            table(py, &colors, 3)?,
        ])
    }

    fn opacity_logits(&self) -> &[f32] {
        &self.opacity_logits
    }
}

/// A copy of numbers as a read-only array with so many columns.
fn table(py: Python<'_>, values: &[f32], columns: usize) -> PyResult<Py<PyAny>> {
    Ok(owned(py, values.to_vec(), [values.len() / columns, columns])?.into_any().unbind())
}

impl Observation {
    pub(crate) fn of<S: SeenScene>(py: Python<'_>, observation: &gs_density::Observation<'_, S>) -> PyResult<Self> {
        let gs_density::Observation { scene, statistics, residual, extent, step, progress, budget, .. } = *observation;
        let len = scene.len();
        let [means, log_scales, rotations, colors] = scene.arrays(py)?;
        let logits = Some(scene.opacity_logits()).filter(|logits| logits.len() == len);
        let signal: Vec<f32> = (0..len).map(|index| statistics.mean_signal(index)).collect();
        let image = |image: &Image| Ok::<_, PyErr>(readonly(of_image(py, image)?.readwrite()).unbind());
        let weights = residual.and_then(|residual| residual.weights.as_ref().map(|weights| (residual, weights)));
        let weights = weights.map(|(residual, weights)| {
            let (width, height) = residual.target.size();
            owned(py, weights.to_vec(), [height as usize, width as usize]).map(Bound::unbind)
        });
        Ok(Self {
            means,
            log_scales,
            rotations,
            opacity_logits: logits.map(|logits| owned(py, logits.to_vec(), [len]).map(Bound::unbind)).transpose()?,
            colors,
            signal: owned(py, signal, [len])?.unbind(),
            visible: owned(py, statistics.visible.clone(), [len])?.unbind(),
            target: residual.map(|residual| image(&residual.target)).transpose()?,
            rendered: residual.map(|residual| image(&residual.rendered)).transpose()?,
            weights: weights.transpose()?,
            extent,
            step,
            progress,
            budget,
        })
    }
}

#[pymethods]
impl Observation {
    fn __len__(&self, py: Python<'_>) -> usize {
        self.signal.bind(py).len()
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let len = self.__len__(py);
        format!("<Observation after step {}, {len} of {} Gaussians>", self.step, self.budget)
    }
}
