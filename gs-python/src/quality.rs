//! Images, and their quality against references.

use std::path::PathBuf;

use gs_backend::block_on;
use gs_train::{
    ImageQuality,
    train::{Views, evaluate as evaluate_views},
};
use numpy::PyArray3;
use pyo3::prelude::*;

use crate::{
    backend,
    convert::{arrays, dataset::read_dataset, errors, settings},
    scene::scene3d::Scene3d,
};

#[doc = doc!("read_image")]
#[pyfunction]
pub(crate) fn read_image(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyArray3<f32>>> {
    let read = errors::computed(py, || gs_io::read_image(path))?;
    arrays::of_image(py, &read.image)
}

#[doc = doc!("write_png")]
#[pyfunction]
pub(crate) fn write_png(py: Python<'_>, path: PathBuf, image: &Bound<'_, PyAny>) -> PyResult<()> {
    let image = arrays::image("image", image)?;
    errors::computed(py, || gs_io::write_png(path, &image))
}

#[doc = doc!("compare")]
#[pyfunction]
pub(crate) fn compare<'py>(
    py: Python<'py>,
    image: &Bound<'py, PyAny>,
    reference: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyAny>> {
    let image = arrays::image_or_file(py, "image", image)?;
    let reference = arrays::image_or_file(py, "reference", reference)?;
    let quality = errors::computed(py, || ImageQuality::as_written(&image, &reference))?;
    let found = settings::to_python(py, &quality)?;
    // JSON has no infinity.
    found.set_item("psnr", quality.psnr)?;
    Ok(found)
}

#[doc = doc!("evaluate")]
#[pyfunction]
#[pyo3(signature = (scene, dataset, *, reading = None, settings = None, backend = None))]
pub(crate) fn evaluate<'py>(
    py: Python<'py>,
    scene: &Bound<'py, Scene3d>,
    dataset: PathBuf,
    reading: Option<&Bound<'py, PyAny>>,
    settings: Option<&Bound<'py, PyAny>>,
    backend: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let of = scene.get();
    let dataset = read_dataset(py, &dataset, reading, Some(of.frame()))?;
    let render = settings::with("settings", of.render(dataset.kind.background()), settings)?;
    let chosen = backend::chosen(py, backend)?;
    let scene = of.scene.clone();
    let evaluation = chosen.compute_within(py, |on| {
        let views = Views::of_dataset(&dataset);
        block_on(evaluate_views(on, &scene, views.test_or_train(), &render))
    })?;
    let found = settings::to_python(py, &evaluation)?;
    found.set_item("psnr", evaluation.psnr)?;
    Ok(found)
}
