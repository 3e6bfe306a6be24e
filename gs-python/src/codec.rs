//! Compressed images: `.gsi` files as bytes.

use gs_backend::block_on;
use gs_codec::Extent;
use gs_core::{Canvas, to_8_bits};
use gs_io::{File2d, GsiFile, StoredImage, decode_gsi};
use gs_train::{EncodeLayers, EncodeSettings, EncodeTarget, Tune, draw_picture};
use numpy::{PyArray1, PyArray3, PyArrayMethods};
use pyo3::{
    prelude::*,
    types::{PyAny, PyBytes},
};

use crate::{
    backend,
    convert::{
        arrays,
        errors::{self, IntoPython},
        settings,
    },
    scene::scene2d::Scene2d,
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
#[pyo3(signature = (image, *, quality = None, psnr = None, bytes = None, bpp = None, tune = "psnr", progressive = false,
    preview = false, seed = 0, backend = None))]
#[allow(clippy::too_many_arguments, reason = "keyword arguments")]
pub(crate) fn encode(
    py: Python<'_>,
    image: &Bound<'_, PyAny>,
    quality: Option<u8>,
    psnr: Option<f64>,
    bytes: Option<u64>,
    bpp: Option<f64>,
    tune: &str,
    progressive: bool,
    preview: bool,
    seed: u32,
    backend: Option<&Bound<'_, PyAny>>,
) -> PyResult<Encoded> {
    let image = arrays::stored_image(py, "image", image)?;
    let target = match (quality, psnr, bytes, bpp) {
        (None, None, None, None) => EncodeTarget::Quality(50),
        (Some(quality), None, None, None) => EncodeTarget::Quality(quality),
        (None, Some(psnr), None, None) => EncodeTarget::Psnr(psnr),
        (None, None, Some(bytes), None) => EncodeTarget::Bytes(bytes),
        (None, None, None, Some(bits)) if bits > 0.0 && bits.is_finite() => {
            EncodeTarget::Bytes((bits * image.image.pixels().len() as f64 / 8.0) as u64)
        }
        (None, None, None, Some(_)) => return Err(errors::value("bpp", "must be a finite number above 0")),
        _ => return Err(errors::value("quality, psnr, bytes, bpp", "expected at most one of them")),
    };
    let tune: Tune = settings::named("tune", tune)?;
    let layers = match (progressive, preview) {
        (false, false) => EncodeLayers::One,
        (true, false) => EncodeLayers::Progressive,
        (false, true) => EncodeLayers::Preview,
        (true, true) => return Err(errors::value("progressive, preview", "expected at most one of them")),
    };
    let wanted =
        EncodeSettings::default().with(|s| (s.target, s.tune, s.layers, s.seed) = (target, tune, layers, seed));
    wanted.validate().map_err(IntoPython::into_python)?;
    let chosen = backend::chosen(py, backend)?;
    let encoded = chosen.compute_within(py, |on| block_on(gs_train::encode(on, &image, &wanted, &|_| ())))?;
    let data = PyBytes::new(py, &encoded.bytes).unbind();
    Ok(Encoded { data, gaussians: encoded.gaussians, psnr: encoded.psnr, seconds: encoded.seconds })
}

#[doc = doc!("decode")]
#[pyfunction]
#[pyo3(signature = (data, *, partial = false))]
pub(crate) fn decode(py: Python<'_>, data: &[u8], partial: bool) -> PyResult<Scene2d> {
    decoded(py, data, partial).map(|file| Scene2d::of_file(file.on([1.0; 3])))
}

#[doc = doc!("decode_image")]
#[pyfunction]
#[pyo3(signature = (data, *, size = None, partial = false, backend = None))]
pub(crate) fn decode_image<'py>(
    py: Python<'py>,
    data: &[u8],
    size: Option<(u32, u32)>,
    partial: bool,
    backend: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArray3<u8>>> {
    let picture = decoded(py, data, partial)?;
    let File2d { width, height, .. } = picture.colors;
    let (columns, rows) = size.unwrap_or((width, height));
    let canvas = Canvas::new(width, height).resized(columns, rows);
    let chosen = backend::chosen(py, backend)?;
    let StoredImage { image, alpha, .. } = chosen.compute(py, |on| block_on(draw_picture(on, &picture, &canvas)))?;
    let (bytes, channels) = match alpha {
        None => (image.to_8_bits(), 3),
        Some(alpha) => {
            let pixels = image.pixels().iter().zip(alpha);
            (pixels.flat_map(|(&[r, g, b], alpha)| [r, g, b, alpha].map(to_8_bits)).collect(), 4)
        }
    };
    PyArray1::from_vec(py, bytes).reshape([rows as usize, columns as usize, channels])
}

fn decoded(py: Python<'_>, data: &[u8], partial: bool) -> PyResult<GsiFile> {
    let extent = if partial { Extent::Prefix } else { Extent::Whole };
    errors::computed(py, || decode_gsi(data, extent))
}
