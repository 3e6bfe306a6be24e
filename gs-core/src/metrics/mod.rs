//! How close an image is to another: mean absolute error, PSNR, SSIM, MS-SSIM.

use crate::{error::Error, image::Image};

/// Mean |a − b| over pixels and channels.
///
/// # Errors
/// [`Error::SizesDiffer`].
pub fn mean_absolute_error(a: &Image, b: &Image) -> Result<f64, Error> {
    a.same_size(b)?;
    let sum: f64 = differences(a, b).map(f64::abs).sum();
    Ok(sum / (3 * a.pixels().len()) as f64)
}

/// Peak signal-to-noise ratio, dB: 10 log₁₀(1 / mean (a − b)²), with peak 1; ∞ for equal images. Clamp both images first
/// ([`Image::clamped`]) for the figure that the field reports.
///
/// # Errors
/// [`Error::SizesDiffer`].
pub fn psnr(a: &Image, b: &Image) -> Result<f64, Error> {
    a.same_size(b)?;
    let sum: f64 = differences(a, b).map(|d| d * d).sum();
    Ok(-10.0 * (sum / (3 * a.pixels().len()) as f64).log10())
}

fn differences<'a>(a: &'a Image, b: &'a Image) -> impl Iterator<Item = f64> + 'a {
    let (a, b) = (a.pixels().as_flattened(), b.pixels().as_flattened());
    a.iter().zip(b).map(|(&a, &b)| f64::from(a) - f64::from(b))
}
