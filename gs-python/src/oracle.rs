//! The oracle, which renders and differentiates densely in 64 bits, for comparison.

use gs_core::RenderSettings;
use gs_oracle::{Oracle, OracleScene, OracleView};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods as _};
use pyo3::prelude::*;

use crate::{
    convert::{arrays, errors},
    render::{Viewed, viewed},
    scene::camera::Camera,
};

#[doc = doc!("oracle_render")]
#[pyfunction]
#[pyo3(signature = (scene, camera = None, *, size = None, settings = None))]
pub(crate) fn oracle_render<'py>(
    py: Python<'py>,
    scene: &Bound<'py, PyAny>,
    camera: Option<&Bound<'py, Camera>>,
    size: Option<(u32, u32)>,
    settings: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    fn rendered(
        view: impl OracleView,
        settings: RenderSettings,
        scene: &OracleScene,
    ) -> Result<gs_oracle::Rendering, gs_core::Error> {
        Ok(Oracle::new(view, settings)?.render(scene))
    }
    let viewed = viewed(scene, camera, size, settings)?;
    let scene = viewed.oracle_scene();
    let image = errors::computed(py, || match viewed {
        Viewed::TwoD(_, canvas, settings) => rendered(canvas, settings, &scene),
        Viewed::ThreeD(_, camera, settings) => rendered(camera, settings, &scene),
    })?;
    let flat = PyArray1::from_slice(py, image.pixels.as_flattened());
    flat.reshape([image.height as usize, image.width as usize, 3])
}

#[doc = doc!("oracle_gradient")]
#[pyfunction]
#[pyo3(signature = (scene, v_image, camera = None, *, size = None, settings = None))]
pub(crate) fn oracle_gradient<'py>(
    py: Python<'py>,
    scene: &Bound<'py, PyAny>,
    v_image: &Bound<'py, PyAny>,
    camera: Option<&Bound<'py, Camera>>,
    size: Option<(u32, u32)>,
    settings: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    fn differentiated(
        view: impl OracleView,
        settings: RenderSettings,
        scene: &OracleScene,
        v_image: &gs_core::Image,
    ) -> Result<Vec<Vec<f64>>, gs_core::Error> {
        Ok(Oracle::new(view, settings)?.image_vjp(scene, v_image)?.values)
    }
    let viewed = viewed(scene, camera, size, settings)?;
    let (columns, rows) = match &viewed {
        Viewed::TwoD(_, canvas, _) => (canvas.width, canvas.height),
        Viewed::ThreeD(_, camera, _) => (camera.width, camera.height),
    };
    let v_image = arrays::v_image("v_image", v_image, [rows as usize, columns as usize])?;
    let scene = viewed.oracle_scene();
    let rows = errors::computed(py, || match viewed {
        Viewed::TwoD(_, canvas, settings) => differentiated(canvas, settings, &scene, &v_image),
        Viewed::ThreeD(_, camera, settings) => differentiated(camera, settings, &scene, &v_image),
    })?;
    Ok(PyArray2::from_vec2(py, &rows)?)
}
