//! `forward` and `ForwardPass`: renderings that can be differentiated.

use std::sync::{Arc, Mutex, PoisonError};

use gs_backend::{AnyForwardPass, AnySplats, block_on};
use gs_core::{CameraGradient, Parameterization, Rasterizer as _};
use numpy::{PyArray1, PyArray3, PyArrayMethods as _, PyUntypedArrayMethods as _};
use pyo3::{IntoPyObjectExt, exceptions::PyRuntimeError, prelude::*, types::PyDict};

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
    /// `None` before it has been used, and where the settings do not ask for it.
    camera_gradient: Mutex<Option<CameraGradient>>,
}

#[derive(Debug)]
enum Pass {
    TwoD(Box<(AnySplats<gs_core::Scene2d>, AnyForwardPass<gs_core::Scene2d>)>),
    /// And whether the gradient by the camera is asked for.
    ThreeD(Box<(AnySplats<gs_core::Scene3d>, AnyForwardPass<gs_core::Scene3d>)>, bool),
}

/// Gradients of a loss by the parameters of a scene of either kind, and by the camera.
enum Gradient {
    TwoD(gs_core::Scene2d),
    ThreeD(gs_core::Scene3d, Option<CameraGradient>),
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
            Ok::<_, gs_core::Error>((image, Pass::ThreeD(Box::new((splats, pass)), settings.camera_gradient)))
        }
    })?;
    let image = arrays::of_image(py, &image)?;
    let image = arrays::readonly(image.readwrite()).unbind();
    Ok(ForwardPass { image, on, pass: Mutex::new(Some(pass)), camera_gradient: Mutex::default() })
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
            Pass::ThreeD(both, asks) => {
                let (splats, pass) = *both;
                let gradients = block_on(on.for_3d().image_vjp(&splats, pass, &v_image))?;
                let by_camera = asks.then(|| block_on(on.for_3d().camera_gradient(&gradients))).transpose()?;
                let scene = block_on(on.for_3d().gradients(&splats, &gradients))?;
                Ok(Gradient::ThreeD(scene, by_camera))
            }
        })?;
        match gradient {
            Gradient::TwoD(gradient) => Scene2d::of(gradient).into_py_any(py),
            Gradient::ThreeD(gradient, by_camera) => {
                *self.camera_gradient.lock().unwrap_or_else(PoisonError::into_inner) = by_camera;
                Scene3d::of(gradient, None, gs_io::WorldFrame::WORLD).into_py_any(py)
            }
        }
    }

    #[doc = doc!("ForwardPass.camera_gradient")]
    #[getter]
    fn camera_gradient<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let Some(gradient) = *self.camera_gradient.lock().unwrap_or_else(PoisonError::into_inner) else {
            return Err(PyRuntimeError::new_err(
                "no gradient by the camera: render a 3D scene with settings={\"camera-gradient\": True}, and call \
                 backward first",
            ));
        };
        let parts = PyDict::new(py);
        parts.set_item("translation", PyArray1::from_slice(py, &gradient.translation.to_array()))?;
        parts.set_item("rotation", PyArray1::from_slice(py, &gradient.rotation.to_array()))?;
        parts.set_item("focal", PyArray1::from_slice(py, &gradient.focal.to_array()))?;
        parts.set_item("center", PyArray1::from_slice(py, &gradient.center.to_array()))?;
        Ok(parts)
    }
}
