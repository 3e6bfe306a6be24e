//! `Scene2d`: the Gaussians of a fitted image.

use std::{path::PathBuf, sync::Arc};

use bytemuck::cast_slice;
use gs_core::{Blend, RenderSettings, Scene as _};
use gs_io::File2d;
use numpy::{PyArray1, PyArray2};
use pyo3::{prelude::*, types::PyAny};

use crate::{
    arrays::{self, Side, Values},
    errors::IntoPython,
};

/// Gaussians in the image plane.
#[pyclass(frozen, module = "gaussian_splats")]
#[derive(Debug)]
pub(crate) struct Scene2d {
    pub(crate) scene: Arc<gs_core::Scene2d>,
    /// How the scene is to be rendered, where that is known.
    pub(crate) render: Option<RenderSettings>,
    /// Columns and rows of the image that the scene was made for, where they are known.
    pub(crate) size: Option<(u32, u32)>,
}

impl Scene2d {
    pub(crate) fn of(scene: gs_core::Scene2d) -> Self {
        Self { scene: Arc::new(scene), render: None, size: None }
    }

    /// How the scene is to be rendered: Gaussians without opacity are summed.
    pub(crate) fn render(&self) -> RenderSettings {
        let blend = if self.scene.opacity_logits.is_empty() { Blend::Sum } else { Blend::Over };
        self.render.unwrap_or_else(|| RenderSettings::blended(blend))
    }

    pub(crate) fn of_file(file: File2d) -> Self {
        Self { scene: Arc::new(file.scene), render: Some(file.settings), size: Some((file.width, file.height)) }
    }
}

#[pymethods]
impl Scene2d {
    #[new]
    #[pyo3(signature = (means, log_scales, rotations, colors, opacity_logits = None))]
    fn new(
        means: &Bound<'_, PyAny>,
        log_scales: &Bound<'_, PyAny>,
        rotations: &Bound<'_, PyAny>,
        colors: &Bound<'_, PyAny>,
        opacity_logits: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let (means, shape) = arrays::floats("means", means, &[Side::Any("N"), Side::Exactly(2)], Values::Finite)?;
        let n = Side::Exactly(shape[0]);
        let of =
            |argument, value, sides: &[Side]| Ok::<_, PyErr>(arrays::floats(argument, value, sides, Values::Finite)?.0);
        let opacity_logits = match opacity_logits {
            Some(logits) => arrays::floats("opacity_logits", logits, &[n], Values::Infinite)?.0,
            None => Vec::new(),
        };
        let scene = gs_core::Scene2d {
            means: cast_slice(&means).to_vec(),
            log_scales: cast_slice(&of("log_scales", log_scales, &[n, Side::Exactly(2)])?).to_vec(),
            rotations: of("rotations", rotations, &[n])?,
            opacity_logits,
            colors: cast_slice(&of("colors", colors, &[n, Side::Exactly(3)])?).to_vec(),
        };
        scene.validate().map_err(IntoPython::into_python)?;
        Ok(Self::of(scene))
    }

    #[getter]
    fn means<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let scene = &this.get().scene;
        arrays::view(this.clone().into_any(), [scene.len(), 2], cast_slice(&scene.means))
    }

    #[getter]
    fn log_scales<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let scene = &this.get().scene;
        arrays::view(this.clone().into_any(), [scene.len(), 2], cast_slice(&scene.log_scales))
    }

    #[getter]
    fn rotations<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray1<f32>>> {
        let scene = &this.get().scene;
        arrays::view(this.clone().into_any(), [scene.len()], &scene.rotations)
    }

    #[getter]
    fn colors<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let scene = &this.get().scene;
        arrays::view(this.clone().into_any(), [scene.len(), 3], cast_slice(&scene.colors))
    }

    #[getter]
    fn opacity_logits<'py>(this: &Bound<'py, Self>) -> PyResult<Option<Bound<'py, PyArray1<f32>>>> {
        let scene = &this.get().scene;
        if scene.opacity_logits.is_empty() && scene.len() > 0 {
            return Ok(None);
        }
        arrays::view(this.clone().into_any(), [scene.len()], &scene.opacity_logits).map(Some)
    }

    /// Size (columns, rows) of the image that the scene was made for; None where it is not known.
    #[getter]
    fn size(&self) -> Option<(u32, u32)> {
        self.size
    }

    fn __len__(&self) -> usize {
        self.scene.len()
    }

    fn __repr__(&self) -> String {
        let size = self.size.map_or_else(String::new, |(width, height)| format!(" of {width}x{height} px"));
        format!("<Scene2d{size}, {} Gaussians>", self.scene.len())
    }

    /// Writes the scene to a file whose name ends in `.gs2d.safetensors`.
    #[pyo3(signature = (path, size = None))]
    fn save(&self, py: Python<'_>, path: PathBuf, size: Option<(u32, u32)>) -> PyResult<()> {
        let Some((width, height)) = size.or(self.size) else {
            let problem = "the scene does not know the size of its image; pass (columns, rows)";
            return Err(crate::errors::value("size", problem));
        };
        let settings = self.render();
        let file = File2d { scene: gs_core::Scene2d::clone(&self.scene), width, height, settings };
        py.detach(|| gs_io::write_2d(path, &file)).map_err(IntoPython::into_python)
    }
}
