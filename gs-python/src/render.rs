//! Renderings.

use std::sync::Arc;

use gs_backend::block_on;
use gs_core::{Canvas, Parameterization, Rasterizer as _, RenderSettings};
use gs_io::draw_with_alpha;
use numpy::PyArray3;
use pyo3::prelude::*;

use crate::{
    backend,
    convert::{arrays, errors, settings},
    scene::{camera::Camera, scene2d::Scene2d, scene3d::Scene3d},
};

/// A scene of either kind with its view.
pub(crate) enum Viewed {
    TwoD(Arc<gs_core::Scene2d>, Canvas, RenderSettings),
    ThreeD(Arc<gs_core::Scene3d>, gs_core::Camera, RenderSettings),
}

/// The scene, the view and the settings of a rendering.
pub(crate) fn viewed(
    scene: &Bound<'_, PyAny>,
    camera: Option<&Bound<'_, Camera>>,
    size: Option<(u32, u32)>,
    over: Option<&Bound<'_, PyAny>>,
) -> PyResult<Viewed> {
    if let Ok(scene) = scene.cast::<Scene2d>() {
        if camera.is_some() {
            return Err(errors::value("camera", "a 2D scene has none; pass size=(columns, rows)"));
        }
        let of = scene.get();
        let (columns, rows) = of.size_or(size)?;
        let (width, height) = of.size.unwrap_or((columns, rows));
        let canvas = Canvas::new(width, height).resized(columns, rows);
        return Ok(Viewed::TwoD(of.scene.clone(), canvas, settings::with("settings", of.render(), over)?));
    }
    let wrong = |_| errors::wrong_type("scene", "Scene2d or Scene3d", scene);
    let of = scene.cast::<Scene3d>().map_err(wrong)?.get();
    let Some(camera) = camera else { return Err(errors::value("camera", "a 3D scene needs one")) };
    let usual = of.render([0.0; 3]);
    let mut camera = camera.get().camera;
    if let Some((width, height)) = size {
        camera = camera.resized(width, height);
    }
    Ok(Viewed::ThreeD(of.scene.clone(), camera, settings::with("settings", usual, over)?))
}

#[doc = doc!("render")]
#[pyfunction]
#[pyo3(signature = (scene, camera = None, *, size = None, alpha = false, settings = None, backend = None))]
pub(crate) fn render<'py>(
    py: Python<'py>,
    scene: &Bound<'py, PyAny>,
    camera: Option<&Bound<'py, Camera>>,
    size: Option<(u32, u32)>,
    alpha: bool,
    settings: Option<&Bound<'py, PyAny>>,
    backend: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let viewed = viewed(scene, camera, size, settings)?;
    let chosen = backend::chosen(py, backend)?;
    if alpha {
        let Viewed::ThreeD(scene, camera, settings) = &viewed else {
            let problem = "only renderings of 3D scenes have one; decode_image() gives that of a .gsi file";
            return Err(errors::value("alpha", problem));
        };
        let image = chosen.compute(py, |on| {
            block_on(async {
                let splats = on.upload(&**scene, Parameterization::ScaleRotation)?;
                Ok::<_, gs_core::Error>(draw_with_alpha(on, &splats, camera, settings).await?.0)
            })
        })?;
        return arrays::of_stored(py, image);
    }
    let image = chosen.compute(py, |on| match &viewed {
        Viewed::TwoD(scene, canvas, settings) => block_on(on.render(&**scene, canvas, settings)),
        Viewed::ThreeD(scene, camera, settings) => block_on(on.render(&**scene, camera, settings)),
    })?;
    arrays::of_image(py, &image)
}
