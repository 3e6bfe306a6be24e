//! `Scene3d`: the Gaussians of a 3D scene.

use std::{path::PathBuf, sync::Arc};

use bytemuck::cast_slice;
use gs_core::{Blend, RenderSettings, Scene as _, math::sh};
use gs_io::{AnyScene, TrainedWith, Values as AllowedValues, WriteOptions3d};
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::{IntoPyObjectExt, prelude::*, types::PyAny};

use crate::{
    arrays::{self, Side, Values},
    errors::{self, IntoPython},
    scene2d::Scene2d,
};

/// Gaussians in 3D.
#[pyclass(frozen, module = "gaussian_splats")]
#[derive(Debug)]
pub(crate) struct Scene3d {
    pub(crate) scene: Arc<gs_core::Scene3d>,
    /// How the scene is to be rendered, where that is known.
    pub(crate) render: Option<RenderSettings>,
}

impl Scene3d {
    pub(crate) fn of(scene: gs_core::Scene3d, render: Option<RenderSettings>) -> Self {
        Self { scene: Arc::new(scene), render }
    }
}

/// The settings of renderings of scenes that do not say how they were trained.
pub(crate) fn usual_render(scene: &gs_core::Scene3d) -> RenderSettings {
    let mut settings = RenderSettings::blended(Blend::Over).on([0.0; 3]);
    settings.effects.order = gs_core::effects::Order::Global;
    settings.effects.antialias = gs_core::effects::Antialias::Dilate;
    settings.effects.sh_degree = scene.sh_degree;
    settings
}

#[pymethods]
impl Scene3d {
    #[new]
    fn new(
        means: &Bound<'_, PyAny>,
        log_scales: &Bound<'_, PyAny>,
        rotations: &Bound<'_, PyAny>,
        opacity_logits: &Bound<'_, PyAny>,
        sh: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let (means, shape) = arrays::floats("means", means, &[Side::Any("N"), Side::Exactly(3)], Values::Finite)?;
        let n = Side::Exactly(shape[0]);
        let of =
            |argument, value, sides: &[Side]| Ok::<_, PyErr>(arrays::floats(argument, value, sides, Values::Finite)?.0);
        let (sh, sh_shape) = arrays::floats("sh", sh, &[n, Side::Any("K"), Side::Exactly(3)], Values::Finite)?;
        let Some(sh_degree) = (0..=3).find(|&degree| sh::coefficients(degree) == sh_shape[1]) else {
            let problem = format!("expected 1, 4, 9 or 16 coefficients, not {}", sh_shape[1]);
            return Err(errors::value("sh", problem));
        };
        let scene = gs_core::Scene3d {
            means: cast_slice(&means).to_vec(),
            log_scales: cast_slice(&of("log_scales", log_scales, &[n, Side::Exactly(3)])?).to_vec(),
            rotations: cast_slice(&of("rotations", rotations, &[n, Side::Exactly(4)])?).to_vec(),
            opacity_logits: arrays::floats("opacity_logits", opacity_logits, &[n], Values::Infinite)?.0,
            sh_degree,
            sh: cast_slice(&sh).to_vec(),
        };
        scene.validate().map_err(IntoPython::into_python)?;
        Ok(Self::of(scene, None))
    }

    #[getter]
    fn means<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let scene = &this.get().scene;
        arrays::view(this.clone().into_any(), [scene.len(), 3], cast_slice(&scene.means))
    }

    #[getter]
    fn log_scales<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let scene = &this.get().scene;
        arrays::view(this.clone().into_any(), [scene.len(), 3], cast_slice(&scene.log_scales))
    }

    #[getter]
    fn rotations<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let scene = &this.get().scene;
        arrays::view(this.clone().into_any(), [scene.len(), 4], cast_slice(&scene.rotations))
    }

    #[getter]
    fn opacity_logits<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray1<f32>>> {
        let scene = &this.get().scene;
        arrays::view(this.clone().into_any(), [scene.len()], &scene.opacity_logits)
    }

    #[getter]
    fn sh<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let scene = &this.get().scene;
        arrays::view(this.clone().into_any(), [scene.len(), scene.sh_len(), 3], cast_slice(&scene.sh))
    }

    /// SH degree, 0 to 3.
    #[getter]
    fn sh_degree(&self) -> u8 {
        self.scene.sh_degree
    }

    fn __len__(&self) -> usize {
        self.scene.len()
    }

    fn __repr__(&self) -> String {
        format!("<Scene3d, {} Gaussians of SH degree {}>", self.scene.len(), self.scene.sh_degree)
    }

    /// Writes the scene to a file; its format follows from the name.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let options = WriteOptions3d::default().with(|options| {
            if let Some(render) = &self.render {
                options.trained_with = TrainedWith::default().with(|trained| {
                    trained.antialias = Some(render.effects.antialias);
                    trained.order = Some(render.effects.order);
                });
            }
        });
        py.detach(|| gs_io::write_3d(path, &self.scene, &options)).map_err(IntoPython::into_python)?;
        Ok(())
    }
}

/// Reads a scene: a scene file of any format, a checkpoint, or the output folder of a fit or a
/// training.
#[pyfunction]
pub(crate) fn load(py: Python<'_>, path: PathBuf) -> PyResult<Py<PyAny>> {
    let file = py.detach(|| gs_io::read_scene(path, AllowedValues::Checked)).map_err(IntoPython::into_python)?;
    match file.scene {
        AnyScene::TwoD(file) => Scene2d::of_file(*file).into_py_any(py),
        AnyScene::ThreeD(file) => {
            let render = file.render_settings(None);
            Scene3d::of(file.scene, Some(render)).into_py_any(py)
        }
    }
}
