//! `Scene2d`: the Gaussians of a fitted image.

use std::{path::PathBuf, sync::Arc};

use bytemuck::cast_slice;
use gs_backend::block_on;
use gs_core::{Blend, Canvas, Rasterizer as _, RenderSettings, Scene as _};
use gs_io::{File2d, IccProfile, PngExtras, SCENE_EXTENSION, png_bytes_with};
use numpy::{PyArray1, PyArray2};
use pyo3::{
    exceptions::PyValueError,
    prelude::*,
    types::{PyAny, PyBytes, PyDict},
};

use crate::{
    backend,
    convert::{
        arrays::{self, Side, Values},
        errors::{self, IntoPython},
    },
};

#[doc = doc!("Scene2d")]
#[pyclass(frozen, module = "gaussian_splats")]
#[derive(Debug)]
pub(crate) struct Scene2d {
    pub(crate) scene: Arc<gs_core::Scene2d>,
    /// How the scene is to be rendered, where that is known.
    pub(crate) render: Option<RenderSettings>,
    /// Columns and rows of the image that the scene was made for, where they are known.
    pub(crate) size: Option<(u32, u32)>,
    /// The profile of the colours; `None` for sRGB.
    pub(crate) profile: Option<IccProfile>,
}

impl Scene2d {
    pub(crate) fn of(scene: gs_core::Scene2d) -> Self {
        Self { scene: Arc::new(scene), render: None, size: None, profile: None }
    }

    /// How the scene is to be rendered: Gaussians without opacity are summed.
    pub(crate) fn render(&self) -> RenderSettings {
        let blend = if self.scene.opacity_logits.is_empty() { Blend::Sum } else { Blend::Over };
        self.render.unwrap_or_else(|| RenderSettings::blended(blend))
    }

    pub(crate) fn of_file(file: File2d) -> Self {
        let File2d { scene, width, height, settings, profile } = file;
        Self { scene: Arc::new(scene), render: Some(settings), size: Some((width, height)), profile }
    }

    /// The given size, or that of the image that the scene was made for.
    pub(crate) fn size_or(&self, size: Option<(u32, u32)>) -> PyResult<(u32, u32)> {
        let problem = "the scene does not know the size of its image; pass (columns, rows)";
        size.or(self.size).ok_or_else(|| errors::value("size", problem))
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
        let opacity_logits = match opacity_logits {
            Some(logits) => arrays::floats("opacity_logits", logits, &[n], Values::Infinite)?.0,
            None => Vec::new(),
        };
        let scene = gs_core::Scene2d {
            means: cast_slice(&means).to_vec(),
            log_scales: cast_slice(&arrays::finite("log_scales", log_scales, &[n, Side::Exactly(2)])?).to_vec(),
            rotations: arrays::finite("rotations", rotations, &[n])?,
            opacity_logits,
            colors: cast_slice(&arrays::finite("colors", colors, &[n, Side::Exactly(3)])?).to_vec(),
        };
        scene.validate().map_err(IntoPython::into_python)?;
        Ok(Self::of(scene))
    }

    #[doc = doc!("Scene2d.means")]
    #[getter]
    fn means<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let scene = &this.get().scene;
        arrays::view(this.clone().into_any(), [scene.len(), 2], cast_slice(&scene.means))
    }

    #[doc = doc!("Scene2d.log_scales")]
    #[getter]
    fn log_scales<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let scene = &this.get().scene;
        arrays::view(this.clone().into_any(), [scene.len(), 2], cast_slice(&scene.log_scales))
    }

    #[doc = doc!("Scene2d.rotations")]
    #[getter]
    fn rotations<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray1<f32>>> {
        let scene = &this.get().scene;
        arrays::view(this.clone().into_any(), [scene.len()], &scene.rotations)
    }

    #[doc = doc!("Scene2d.colors")]
    #[getter]
    fn colors<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let scene = &this.get().scene;
        arrays::view(this.clone().into_any(), [scene.len(), 3], cast_slice(&scene.colors))
    }

    #[doc = doc!("Scene2d.opacity_logits")]
    #[getter]
    fn opacity_logits<'py>(this: &Bound<'py, Self>) -> PyResult<Option<Bound<'py, PyArray1<f32>>>> {
        let scene = &this.get().scene;
        if scene.opacity_logits.is_empty() && scene.len() > 0 {
            return Ok(None);
        }
        arrays::view(this.clone().into_any(), [scene.len()], &scene.opacity_logits).map(Some)
    }

    #[doc = doc!("Scene2d.arrays")]
    #[getter]
    fn arrays<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyDict>> {
        arrays::by_name(this.as_any(), &["means", "log_scales", "rotations", "colors", "opacity_logits"])
    }

    #[doc = doc!("Scene2d.size")]
    #[getter]
    fn size(&self) -> Option<(u32, u32)> {
        self.size
    }

    #[doc = doc!("Scene2d.profile")]
    #[getter]
    fn profile<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyBytes>> {
        self.profile.as_ref().map(|profile| PyBytes::new(py, profile.bytes()))
    }

    fn __len__(&self) -> usize {
        self.scene.len()
    }

    fn __repr__(&self) -> String {
        let size = self.size.map_or_else(String::new, |(width, height)| format!(" of {width}x{height} px"));
        format!("<Scene2d{size}, {} Gaussians>", self.scene.len())
    }

    #[doc = doc!("Scene2d.save")]
    #[pyo3(signature = (path, size = None))]
    fn save(&self, py: Python<'_>, path: PathBuf, size: Option<(u32, u32)>) -> PyResult<()> {
        let (width, height) = self.size_or(size)?;
        if !path.to_string_lossy().ends_with(&format!(".{SCENE_EXTENSION}")) {
            let path = path.display();
            let message = format!("{path}: cannot write a 2D scene in this format: use .{SCENE_EXTENSION}");
            return Err(PyValueError::new_err(message));
        }
        let (scene, profile) = (gs_core::Scene2d::clone(&self.scene), self.profile.clone());
        let file = File2d { scene, width, height, settings: self.render(), profile };
        errors::computed(py, || gs_io::write_2d(path, &file))
    }

    #[doc = doc!("Scene2d._repr_png_")]
    fn _repr_png_<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyBytes>>> {
        let Some((width, height)) = self.size else { return Ok(None) };
        let (scene, settings) = (self.scene.clone(), self.render());
        let image = backend::chosen(py, None)?
            .compute(py, |on| block_on(on.render(&*scene, &Canvas::new(width, height), &settings)))?;
        let extras = PngExtras { profile: self.profile.as_ref(), ..PngExtras::default() };
        Ok(Some(PyBytes::new(py, &png_bytes_with(&image, extras))))
    }
}
