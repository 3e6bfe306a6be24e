//! The error of a picture.

use gs_core::{Error, Image, metrics::psnr_of_mse};
use serde::Serialize;

/// A display step of 8 bits.
const DISPLAY_STEP: f64 = 1.0 / 255.0;

/// The error of pictures, over all channels of all pixels, without clamping or rounding to 8 bits,
/// because most approximations change less than a display step. The quality of a fit is measured on
/// 8-bit images ([`gs_train::ImageQuality`]).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct PictureError {
    /// Largest absolute difference; ∞ where a pixel is not a number.
    pub(crate) max: f64,
    /// Mean absolute difference.
    pub(crate) mean: f64,
    /// Mean squared difference.
    pub(crate) mean_squared: f64,
    /// PSNR with peak 1, dB; ∞ without error, which JSON writes as `null`.
    pub(crate) psnr: f64,
    /// Share of the pixels with a channel that is off by more than a display step, 1/255.
    pub(crate) share_visible: f64,
}

impl PictureError {
    /// The error of a picture against another of its size.
    ///
    /// # Errors
    /// [`Error::SizesDiffer`].
    pub(super) fn between(picture: &Image, reference: &Image) -> Result<Self, Error> {
        picture.same_size(reference)?;
        Ok(Self::of(picture.pixels().iter().zip(reference.pixels()).map(|(&a, &b)| difference(a, b.map(f64::from)))))
    }

    /// The error of these pixel differences; all 0 without pixels. NaN counts as ∞.
    pub(super) fn of(differences: impl Iterator<Item = [f64; 3]>) -> Self {
        let (mut max, mut sums, mut pixels) = (0.0f64, [0.0; 3], 0u64);
        for difference in differences {
            let largest = largest(difference);
            max = max.max(largest);
            sums[0] += difference.iter().map(|v| v.abs()).sum::<f64>() / 3.0;
            sums[1] += difference.iter().map(|v| v * v).sum::<f64>() / 3.0;
            sums[2] += f64::from(u8::from(largest > DISPLAY_STEP));
            pixels += 1;
        }
        let mean = |sum: f64| if sum.is_nan() { f64::INFINITY } else { sum / pixels.max(1) as f64 };
        Self::new(max, sums.map(mean))
    }

    /// The error of several views of one size: the largest maximum, and means of the means.
    pub(super) fn of_views(views: &[Self]) -> Self {
        let share = 1.0 / views.len().max(1) as f64;
        let mean = |of: fn(&Self) -> f64| views.iter().map(|view| share * of(view)).sum();
        let max = views.iter().map(|view| view.max).fold(0.0, f64::max);
        Self::new(max, [mean(|view| view.mean), mean(|view| view.mean_squared), mean(|view| view.share_visible)])
    }

    pub(super) fn new(max: f64, [mean, mean_squared, share_visible]: [f64; 3]) -> Self {
        Self { max, mean, mean_squared, psnr: psnr_of_mse(mean_squared), share_visible }
    }
}

/// What a pixel is off by.
pub(super) fn difference(shown: [f32; 3], reference: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|k| f64::from(shown[k]) - reference[k])
}

/// The largest magnitude; ∞ for NaN.
pub(super) fn largest(difference: [f64; 3]) -> f64 {
    difference.iter().fold(0.0, |most: f64, v| if v.is_nan() { f64::INFINITY } else { most.max(v.abs()) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_summed_up_as_they_are_documented() {
        let error = PictureError::of([[0.0; 3], [0.3, 0.0, -0.6]].into_iter());
        assert_eq!((error.max, error.share_visible), (0.6, 0.5));
        assert!((error.mean - 0.15).abs() < 1e-12 && (error.mean_squared - 0.075).abs() < 1e-12);
        assert!((error.psnr - 11.249).abs() < 1e-3);
        let broken = PictureError::of([[f64::NAN; 3], [0.0; 3]].into_iter());
        assert_eq!((broken.max, broken.mean, broken.mean_squared), (f64::INFINITY, f64::INFINITY, f64::INFINITY));
        let nothing = PictureError::of(std::iter::empty());
        assert_eq!((nothing.max, nothing.mean, nothing.psnr), (0.0, 0.0, f64::INFINITY));
    }
}
