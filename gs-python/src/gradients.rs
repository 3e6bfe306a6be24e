//! `ForwardPass`: a rendering that can be differentiated.

use std::sync::{Arc, Mutex, PoisonError};

use gs_backend::{AnyForwardPass, AnySplats, Chosen, block_on};
use gs_core::{Parameterization, Rasterizer as _};
use numpy::PyArray3;
use pyo3::{IntoPyObjectExt, exceptions::PyRuntimeError, prelude::*, types::PyDict};

use crate::{
    arrays,
    backend::{self, Backend},
    camera::Camera,
    errors::IntoPython,
    render::{Viewed, viewed},
    scene2d::Scene2d,
    scene3d::Scene3d,
};

/// A rendering, and what its gradients are computed from.
#[pyclass(frozen, module = "gaussian_splats")]
#[derive(Debug)]
pub(crate) struct ForwardPass {
    image: Py<PyArray3<f32>>,
    chosen: Arc<Chosen>,
    /// `None` after it has been used.
    pass: Mutex<Option<Pass>>,
}

#[derive(Debug)]
enum Pass {
    TwoD(Box<(AnySplats<gs_core::Scene2d>, AnyForwardPass<gs_core::Scene2d>)>),
    ThreeD(Box<(AnySplats<gs_core::Scene3d>, AnyForwardPass<gs_core::Scene3d>)>),
}

#[pymethods]
impl ForwardPass {
    #[new]
    #[pyo3(signature = (scene, camera = None, *, size = None, settings = None, backend = None))]
    fn new(
        py: Python<'_>,
        scene: &Bound<'_, PyAny>,
        camera: Option<&Bound<'_, Camera>>,
        size: Option<(u32, u32)>,
        settings: Option<&Bound<'_, PyDict>>,
        backend: Option<&Bound<'_, Backend>>,
    ) -> PyResult<Self> {
        let viewed = viewed(scene, camera, size, settings)?;
        let chosen = backend::chosen(py, backend)?;
        let on = backend::rasterizer(&chosen);
        let shape = Parameterization::ScaleRotation;
        let (image, pass) = match viewed {
            Viewed::TwoD(scene, canvas, settings) => {
                let scene = scene.get().scene.clone();
                py.detach(|| {
                    let splats = on.upload(&*scene, shape)?;
                    let pass = block_on(on.for_2d().forward(&splats, &canvas, &settings))?;
                    let image = block_on(on.for_2d().image(&pass))?;
                    Ok((image, Pass::TwoD(Box::new((splats, pass)))))
                })
            }
            Viewed::ThreeD(scene, camera, settings) => {
                let scene = scene.get().scene.clone();
                py.detach(|| {
                    let splats = on.upload(&*scene, shape)?;
                    let pass = block_on(on.for_3d().forward(&splats, &camera, &settings))?;
                    let image = block_on(on.for_3d().image(&pass))?;
                    Ok((image, Pass::ThreeD(Box::new((splats, pass)))))
                })
            }
        }
        .map_err(|error: gs_core::Error| error.into_python())?;
        let image = arrays::of_image(py, &image)?;
        let image = arrays::readonly(numpy::PyArrayMethods::readwrite(&image)).unbind();
        Ok(Self { image, chosen, pass: Mutex::new(Some(pass)) })
    }

    /// The rendering, float32 of shape (H, W, 3), not clamped.
    #[getter]
    fn image(&self, py: Python<'_>) -> Py<PyArray3<f32>> {
        self.image.clone_ref(py)
    }

    /// The gradient of a loss by all parameters, from that by the image.
    fn backward(&self, py: Python<'_>, v_image: &Bound<'_, PyAny>) -> PyResult<Py<PyAny>> {
        let v_image = arrays::image("v_image", v_image)?;
        let pass = self.pass.lock().unwrap_or_else(PoisonError::into_inner).take();
        let Some(pass) = pass else {
            return Err(PyRuntimeError::new_err("a forward pass can be used once; make another"));
        };
        let on = backend::rasterizer(&self.chosen);
        match pass {
            Pass::TwoD(both) => {
                let (splats, pass) = *both;
                let found = py.detach(|| {
                    let gradients = block_on(on.for_2d().image_vjp(&splats, pass, &v_image))?;
                    block_on(on.for_2d().gradients(&splats, &gradients))
                });
                Scene2d::of(found.map_err(IntoPython::into_python)?).into_py_any(py)
            }
            Pass::ThreeD(both) => {
                let (splats, pass) = *both;
                let found = py.detach(|| {
                    let gradients = block_on(on.for_3d().image_vjp(&splats, pass, &v_image))?;
                    block_on(on.for_3d().gradients(&splats, &gradients))
                });
                Scene3d::of(found.map_err(IntoPython::into_python)?, None).into_py_any(py)
            }
        }
    }
}
