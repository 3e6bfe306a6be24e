//! `Camera`: a posed pinhole camera.

use glam::{Mat3, Vec2, Vec3};
use pyo3::{prelude::*, types::PyAny};

use super::scene3d::{Scene3d, overview};
use crate::convert::{
    arrays,
    errors::{self, IntoPython},
};

#[doc = doc!("Camera")]
#[pyclass(frozen, module = "gaussian_splats")]
#[derive(Debug)]
pub(crate) struct Camera {
    pub(crate) camera: gs_core::Camera,
}

#[pymethods]
impl Camera {
    #[new]
    #[pyo3(signature = (width, height, *, fx, fy = None, cx = None, cy = None, rotation = None, translation = None, near = None))]
    #[allow(clippy::too_many_arguments, reason = "keyword arguments")]
    fn new(
        width: u32,
        height: u32,
        fx: f32,
        fy: Option<f32>,
        cx: Option<f32>,
        cy: Option<f32>,
        rotation: Option<&Bound<'_, PyAny>>,
        translation: Option<&Bound<'_, PyAny>>,
        near: Option<f32>,
    ) -> PyResult<Self> {
        let usual = gs_core::Camera::looking_forward(width, height, 1.0);
        let center = Vec2::new(cx.unwrap_or(usual.center.x), cy.unwrap_or(usual.center.y));
        let rotation = match rotation {
            // Row by row, as NumPy has them.
            Some(rotation) => Mat3::from_cols_slice(&arrays::small("rotation", rotation, &[3, 3])?).transpose(),
            None => Mat3::IDENTITY,
        };
        let translation = translation.map_or(Ok(Vec3::ZERO), |translation| point("translation", translation))?;
        let focal = Vec2::new(fx, fy.unwrap_or(fx));
        let near = near.unwrap_or(usual.near);
        let camera = gs_core::Camera { rotation, translation, focal, center, near, ..usual };
        camera.validate().map_err(IntoPython::into_python)?;
        Ok(Self { camera })
    }

    #[doc = doc!("Camera.overview")]
    #[staticmethod]
    #[pyo3(signature = (scene, width = 800, height = 600))]
    fn overview(scene: &Bound<'_, Scene3d>, width: u32, height: u32) -> PyResult<Self> {
        let camera = overview(&scene.get().scene, width, height);
        let camera = camera.ok_or_else(|| errors::value("scene", "nothing of it can be seen from outside"))?;
        camera.validate().map_err(IntoPython::into_python)?;
        Ok(Self { camera })
    }

    #[doc = doc!("Camera.looking_at")]
    #[pyo3(signature = (position, target, up = None))]
    fn looking_at(
        &self,
        position: &Bound<'_, PyAny>,
        target: &Bound<'_, PyAny>,
        up: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let (position, target) = (point("position", position)?, point("target", target)?);
        let up = up.map_or(Ok(Vec3::NEG_Y), |up| point("up", up))?;
        let camera = self.camera.looking_at(position, target, up);
        let camera = camera.ok_or_else(|| errors::value("target", "is at the position, or straight up from it"))?;
        Ok(Self { camera })
    }

    #[doc = doc!("Camera.moved")]
    #[pyo3(signature = (translation = None, rotation = None, *, focal = None, center = None))]
    fn moved(
        &self,
        translation: Option<&Bound<'_, PyAny>>,
        rotation: Option<&Bound<'_, PyAny>>,
        focal: Option<&Bound<'_, PyAny>>,
        center: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let translation = translation.map_or(Ok(Vec3::ZERO), |translation| point("translation", translation))?;
        let rotation = rotation.map_or(Ok(Vec3::ZERO), |rotation| point("rotation", rotation))?;
        let pair = |argument: &str, value: Option<&Bound<'_, PyAny>>| match value {
            Some(value) => arrays::small(argument, value, &[2]).map(|numbers| Vec2::from_slice(&numbers)),
            None => Ok(Vec2::ZERO),
        };
        let mut camera = self.camera.moved(translation, rotation);
        camera.focal += pair("focal", focal)?;
        camera.center += pair("center", center)?;
        camera.validate().map_err(IntoPython::into_python)?;
        Ok(Self { camera })
    }

    #[doc = doc!("Camera.resized")]
    fn resized(&self, width: u32, height: u32) -> PyResult<Self> {
        let camera = self.camera.resized(width, height);
        camera.validate().map_err(IntoPython::into_python)?;
        Ok(Self { camera })
    }

    #[doc = doc!("Camera.width")]
    #[getter]
    fn width(&self) -> u32 {
        self.camera.width
    }

    #[doc = doc!("Camera.height")]
    #[getter]
    fn height(&self) -> u32 {
        self.camera.height
    }

    #[doc = doc!("Camera.position")]
    #[getter]
    fn position(&self) -> [f32; 3] {
        self.camera.position().to_array()
    }

    fn __repr__(&self) -> String {
        let gs_core::Camera { width, height, focal, .. } = self.camera;
        format!("<Camera {width}x{height}, focal {:.1}, at {}>", focal.x, self.camera.position())
    }
}

/// A point or a vector of an argument, world units.
fn point(argument: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec3> {
    arrays::small(argument, value, &[3]).map(|numbers| Vec3::from_slice(&numbers))
}
