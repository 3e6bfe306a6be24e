//! How close an image is to another: mean absolute error, PSNR, SSIM, MS-SSIM.

mod ms_ssim;
mod ssim;

pub use ms_ssim::ms_ssim;
pub use ssim::ssim;

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

#[cfg(test)]
mod test_images {
    use crate::image::Image;

    /// A pattern of edges and ramps, and the same under a quarter of noise, from integer formulas that any language repeats.
    pub(super) fn clean_and_noisy(width: u32, height: u32) -> (Image, Image) {
        let clean = Image::from_fn(width, height, |x, y| {
            [0, 1, 2_u32].map(|c| {
                let ramp = f64::from((x * x + 3 * y * (c + 1) + x * y) % 257) / 256.0;
                let blocks = f64::from((x / 16 + y / 12 + c) % 3) / 2.0;
                (ramp * 0.25 + blocks * 0.75) as f32
            })
        })
        .unwrap();
        let noisy = Image::from_fn(width, height, |x, y| {
            [0, 1, 2_u32].map(|c| {
                let noise =
                    (u64::from(x) * 7919 + u64::from(y) * 104_729 + u64::from(c) * 15_485_863 + u64::from(x * y) * 31)
                        % 1021;
                0.75 * clean.pixel(x, y)[c as usize] + 0.25 * (noise as f64 / 1020.0) as f32
            })
        })
        .unwrap();
        (clean, noisy)
    }
}
