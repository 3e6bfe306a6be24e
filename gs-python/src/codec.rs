//! Compressed images: `.gsi` files as bytes.

use gs_backend::block_on;
use gs_codec::Extent;
use gs_train::{EncodeSettings, EncodeTarget};
use pyo3::{
    prelude::*,
    types::{PyAny, PyBytes},
};

use crate::{
    arrays, backend,
    errors::{self, IntoPython},
    scene2d::Scene2d,
};

#[doc = doc!("Encoded")]
#[pyclass(frozen, module = "gaussian_splats", get_all)]
#[derive(Debug)]
pub(crate) struct Encoded {
    #[doc = doc!("Encoded.data")]
    data: Py<PyBytes>,
    #[doc = doc!("Encoded.gaussians")]
    gaussians: usize,
    #[doc = doc!("Encoded.psnr")]
    psnr: f64,
    #[doc = doc!("Encoded.seconds")]
    seconds: f64,
}

#[pymethods]
impl Encoded {
    fn __repr__(&self, py: Python<'_>) -> String {
        let bytes = self.data.bind(py).as_bytes().len();
        format!("<Encoded: {bytes} bytes, {} Gaussians, {:.2} dB>", self.gaussians, self.psnr)
    }
}

#[doc = doc!("encode")]
#[pyfunction]
#[pyo3(signature = (image, *, quality = None, psnr = None, bytes = None, bpp = None, progressive = false, seed = 0,
    backend = None))]
#[allow(clippy::too_many_arguments, reason = "keyword arguments")]
pub(crate) fn encode(
    py: Python<'_>,
    image: &Bound<'_, PyAny>,
    quality: Option<u8>,
    psnr: Option<f64>,
    bytes: Option<u64>,
    bpp: Option<f64>,
    progressive: bool,
    seed: u32,
    backend: Option<&Bound<'_, PyAny>>,
) -> PyResult<Encoded> {
    let image = arrays::image_or_file(py, "image", image)?;
    let target = match (quality, psnr, bytes, bpp) {
        (None, None, None, None) => EncodeTarget::Quality(50),
        (Some(quality), None, None, None) => EncodeTarget::Quality(quality),
        (None, Some(psnr), None, None) => EncodeTarget::Psnr(psnr),
        (None, None, Some(bytes), None) => EncodeTarget::Bytes(bytes),
        (None, None, None, Some(bits)) if bits > 0.0 && bits.is_finite() => {
            EncodeTarget::Bytes((bits * image.pixels().len() as f64 / 8.0) as u64)
        }
        (None, None, None, Some(_)) => return Err(errors::value("bpp", "must be a finite number above 0")),
        _ => return Err(errors::value("quality, psnr, bytes, bpp", "expected at most one of them")),
    };
    let settings = EncodeSettings::default().with(|settings| {
        (settings.target, settings.progressive, settings.seed) = (target, progressive, seed);
    });
    settings.validate().map_err(IntoPython::into_python)?;
    let chosen = backend::chosen(py, backend)?;
    let encoded = chosen.compute_within(py, |on| block_on(gs_train::encode(on, &image, &settings)))?;
    let data = PyBytes::new(py, &encoded.bytes).unbind();
    Ok(Encoded { data, gaussians: encoded.gaussians, psnr: encoded.psnr, seconds: encoded.seconds })
}

#[doc = doc!("decode")]
#[pyfunction]
#[pyo3(signature = (data, *, partial = false))]
pub(crate) fn decode(py: Python<'_>, data: &[u8], partial: bool) -> PyResult<Scene2d> {
    let extent = if partial { Extent::Prefix } else { Extent::Whole };
    let decoded = errors::computed(py, || gs_io::decode_gsi(data, extent));
    decoded.map(Scene2d::of_file)
}
