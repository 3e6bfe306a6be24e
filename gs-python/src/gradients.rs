//! `forward` and `ForwardPass`: renderings that can be differentiated.

use std::sync::{Arc, Mutex, PoisonError};

use gs_backend::{AnyForwardPass, AnySplats, block_on};
use gs_core::{Parameterization, Rasterizer as _};
use numpy::{PyArray3, PyArrayMethods as _, PyUntypedArrayMethods as _};
use pyo3::{IntoPyObjectExt, exceptions::PyRuntimeError, prelude::*};

use crate::{
    backend::{self, Opened},
    convert::arrays,
    render::{Viewed, viewed},
    scene::{camera::Camera, scene2d::Scene2d, scene3d::Scene3d},
};

#[doc = doc!("ForwardPass")]
#[pyclass(frozen, module = "gaussian_splats")]
#[derive(Debug)]
pub(crate) struct ForwardPass {
    image: Py<PyArray3<f32>>,
    on: Arc<Opened>,
    /// `None` after it has been used.
    pass: Mutex<Option<Pass>>,
}

#[derive(Debug)]
enum Pass {
    TwoD(Box<(AnySplats<gs_core::Scene2d>, AnyForwardPass<gs_core::Scene2d>)>),
    ThreeD(Box<(AnySplats<gs_core::Scene3d>, AnyForwardPass<gs_core::Scene3d>)>),
}

/// Gradients of a loss by the parameters of a scene of either kind.
enum Gradient {
    TwoD(gs_core::Scene2d),
    ThreeD(gs_core::Scene3d),
}

#[doc = doc!("forward")]
#[pyfunction]
#[pyo3(signature = (scene, camera = None, *, size = None, settings = None, backend = None))]
pub(crate) fn forward(
    py: Python<'_>,
    scene: &Bound<'_, PyAny>,
    camera: Option<&Bound<'_, Camera>>,
    size: Option<(u32, u32)>,
    settings: Option<&Bound<'_, PyAny>>,
    backend: Option<&Bound<'_, PyAny>>,
) -> PyResult<ForwardPass> {
    let viewed = viewed(scene, camera, size, settings)?;
    let on = backend::chosen(py, backend)?;
    let shape = Parameterization::ScaleRotation;
    let (image, pass) = on.compute(py, |on| match &viewed {
        Viewed::TwoD(scene, canvas, settings) => {
            let splats = on.upload(&**scene, shape)?;
            let pass = block_on(on.for_2d().forward(&splats, canvas, settings))?;
            let image = block_on(on.for_2d().image(&pass))?;
            Ok((image, Pass::TwoD(Box::new((splats, pass)))))
        }
        Viewed::ThreeD(scene, camera, settings) => {
            let splats = on.upload(&**scene, shape)?;
            let pass = block_on(on.for_3d().forward(&splats, camera, settings))?;
            let image = block_on(on.for_3d().image(&pass))?;
            Ok::<_, gs_core::Error>((image, Pass::ThreeD(Box::new((splats, pass)))))
        }
    })?;
    let image = arrays::of_image(py, &image)?;
    let image = arrays::readonly(image.readwrite()).unbind();
    Ok(ForwardPass { image, on, pass: Mutex::new(Some(pass)) })
}

#[pymethods]
impl ForwardPass {
    #[doc = doc!("ForwardPass.image")]
    #[getter]
    fn image(&self, py: Python<'_>) -> Py<PyArray3<f32>> {
        self.image.clone_ref(py)
    }

    #[doc = doc!("ForwardPass.backward")]
    fn backward(&self, py: Python<'_>, v_image: &Bound<'_, PyAny>) -> PyResult<Py<PyAny>> {
        let shape = self.image.bind(py).shape();
        let v_image = arrays::v_image("v_image", v_image, [shape[0], shape[1]])?;
        let pass = self.pass.lock().unwrap_or_else(PoisonError::into_inner).take();
        let Some(pass) = pass else {
            return Err(PyRuntimeError::new_err("a forward pass can be used once; make another"));
        };
        let gradient = self.on.compute(py, |on| match pass {
            Pass::TwoD(both) => {
                let (splats, pass) = *both;
                let gradients = block_on(on.for_2d().image_vjp(&splats, pass, &v_image))?;
                block_on(on.for_2d().gradients(&splats, &gradients)).map(Gradient::TwoD)
            }
            Pass::ThreeD(both) => {
                let (splats, pass) = *both;
                let gradients = block_on(on.for_3d().image_vjp(&splats, pass, &v_image))?;
                block_on(on.for_3d().gradients(&splats, &gradients)).map(Gradient::ThreeD)
            }
        })?;
        match gradient {
            Gradient::TwoD(gradient) => Scene2d::of(gradient).into_py_any(py),
            Gradient::ThreeD(gradient) => Scene3d::of(gradient, None, gs_io::WorldFrame::WORLD).into_py_any(py),
        }
    }
}
