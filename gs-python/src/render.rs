//! Renderings, images, and comparisons of images.

use std::path::PathBuf;

use gs_backend::block_on;
use gs_core::{Canvas, Rasterizer as _, RenderSettings};
use gs_train::ImageQuality;
use numpy::PyArray3;
use pyo3::{prelude::*, types::PyDict};

use crate::{
    arrays,
    backend::{self, Backend},
    camera::Camera,
    errors::{self, IntoPython},
    scene2d::Scene2d,
    scene3d::{Scene3d, usual_render},
    settings,
};

/// A scene of either kind with its view.
pub(crate) enum Viewed<'py> {
    TwoD(Bound<'py, Scene2d>, Canvas, RenderSettings),
    ThreeD(Bound<'py, Scene3d>, gs_core::Camera, RenderSettings),
}

/// The scene, the view and the settings of a rendering.
pub(crate) fn viewed<'py>(
    scene: &Bound<'py, PyAny>,
    camera: Option<&Bound<'py, Camera>>,
    size: Option<(u32, u32)>,
    over: Option<&Bound<'py, PyDict>>,
) -> PyResult<Viewed<'py>> {
    if let Ok(scene) = scene.cast::<Scene2d>() {
        if camera.is_some() {
            return Err(errors::value("camera", "a 2D scene has none; pass size=(columns, rows)"));
        }
        let of = scene.get();
        let Some((width, height)) = of.size.or(size) else {
            let problem = "the scene does not know the size of its image; pass (columns, rows)";
            return Err(errors::value("size", problem));
        };
        let (columns, rows) = size.unwrap_or((width, height));
        let canvas = Canvas::new(width, height).resized(columns, rows);
        return Ok(Viewed::TwoD(scene.clone(), canvas, settings::with("settings", of.render(), over)?));
    }
    let Ok(scene) = scene.cast::<Scene3d>() else {
        let found = scene.get_type().name()?.to_string();
        let message = format!("scene: expected Scene2d or Scene3d, not {found}");
        return Err(pyo3::exceptions::PyTypeError::new_err(message));
    };
    let Some(camera) = camera else { return Err(errors::value("camera", "a 3D scene needs one")) };
    let of = scene.get();
    let usual = of.render.unwrap_or_else(|| usual_render(&of.scene));
    let mut camera = camera.get().camera;
    if let Some((width, height)) = size {
        camera = camera.resized(width, height);
    }
    Ok(Viewed::ThreeD(scene.clone(), camera, settings::with("settings", usual, over)?))
}

/// Renders a scene.
#[pyfunction]
#[pyo3(signature = (scene, camera = None, *, size = None, settings = None, backend = None))]
pub(crate) fn render<'py>(
    py: Python<'py>,
    scene: &Bound<'py, PyAny>,
    camera: Option<&Bound<'py, Camera>>,
    size: Option<(u32, u32)>,
    settings: Option<&Bound<'py, PyDict>>,
    backend: Option<&Bound<'py, Backend>>,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let viewed = viewed(scene, camera, size, settings)?;
    let chosen = backend::chosen(py, backend)?;
    let on = backend::rasterizer(&chosen);
    let image = match viewed {
        Viewed::TwoD(scene, canvas, settings) => {
            let scene = scene.get().scene.clone();
            py.detach(|| block_on(on.render(&*scene, &canvas, &settings)))
        }
        Viewed::ThreeD(scene, camera, settings) => {
            let scene = scene.get().scene.clone();
            py.detach(|| block_on(on.render(&*scene, &camera, &settings)))
        }
    };
    arrays::of_image(py, &image.map_err(IntoPython::into_python)?)
}

/// Reads an image file.
#[pyfunction]
pub(crate) fn read_image(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyArray3<f32>>> {
    let read = py.detach(|| gs_io::read_image(path)).map_err(IntoPython::into_python)?;
    arrays::of_image(py, &read.image)
}

/// Writes an image as PNG.
#[pyfunction]
pub(crate) fn write_png(py: Python<'_>, path: PathBuf, image: &Bound<'_, PyAny>) -> PyResult<()> {
    let image = arrays::image("image", image)?;
    py.detach(|| gs_io::write_png(path, &image)).map_err(IntoPython::into_python)
}

/// The quality of an image, rounded to 8 bits, against a reference.
#[pyfunction]
pub(crate) fn compare<'py>(
    py: Python<'py>,
    image: &Bound<'py, PyAny>,
    reference: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyAny>> {
    let (image, reference) = (arrays::image("image", image)?, arrays::image("reference", reference)?);
    let quality = py.detach(|| ImageQuality::as_written(&image, &reference)).map_err(IntoPython::into_python)?;
    let found = settings::to_python(py, &quality)?;
    // JSON has no infinity.
    found.set_item("psnr", quality.psnr)?;
    Ok(found)
}
