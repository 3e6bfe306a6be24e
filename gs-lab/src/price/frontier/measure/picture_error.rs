//! The error of a picture.

use gs_core::metrics::psnr_of_mse;
use serde::Serialize;

/// A display step of 8 bits.
const DISPLAY_STEP: f64 = 1.0 / 255.0;

/// The error of pictures, over all channels of all pixels, without clamping.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct PictureError {
    /// Largest absolute difference.
    pub max: f64,
    /// Mean absolute difference.
    pub mean: f64,
    /// Mean squared difference.
    pub mean_squared: f64,
    /// Share of the pixels with a channel that is off by more than a display step, 1/255.
    pub share_visible: f64,
}

impl PictureError {
    /// PSNR with peak 1, dB; ∞ without error. It is computed without rounding to 8 bits, because
    /// most approximations change less than a display step. The quality of a fit is measured on
    /// 8-bit images ([`gs_train::ImageQuality`]).
    pub fn psnr(&self) -> f64 {
        psnr_of_mse(self.mean_squared)
    }

    /// The error of these pixel differences; all 0 without pixels. NaN counts as ∞.
    pub(crate) fn of(differences: impl Iterator<Item = [f64; 3]>) -> Self {
        let (mut error, mut pixels) = (Self::default(), 0u64);
        for difference in differences {
            let largest =
                difference.iter().fold(0.0, |m: f64, v| if v.is_nan() { f64::INFINITY } else { m.max(v.abs()) });
            error.max = error.max.max(largest);
            error.mean += difference.iter().map(|v| v.abs()).sum::<f64>() / 3.0;
            error.mean_squared += difference.iter().map(|v| v * v).sum::<f64>() / 3.0;
            error.share_visible += f64::from(u8::from(largest > DISPLAY_STEP));
            pixels += 1;
        }
        let share = 1.0 / pixels.max(1) as f64;
        let mean = |sum: f64| if sum.is_nan() { f64::INFINITY } else { sum * share };
        Self {
            mean: mean(error.mean),
            mean_squared: mean(error.mean_squared),
            share_visible: error.share_visible * share,
            ..error
        }
    }

    /// The error of several views of one size: the largest maximum, and means of the means.
    pub(crate) fn of_views(views: &[Self]) -> Self {
        let share = 1.0 / views.len().max(1) as f64;
        let mut all = Self::default();
        for view in views {
            all.max = all.max.max(view.max);
            all.mean += share * view.mean;
            all.mean_squared += share * view.mean_squared;
            all.share_visible += share * view.share_visible;
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_summed_up_as_they_are_documented() {
        let error = PictureError::of([[0.0; 3], [0.3, 0.0, -0.6]].into_iter());
        assert_eq!((error.max, error.share_visible), (0.6, 0.5));
        assert!((error.mean - 0.15).abs() < 1e-12 && (error.mean_squared - 0.075).abs() < 1e-12);
        assert!((error.psnr() - 11.249).abs() < 1e-3);
        let broken = PictureError::of([[f64::NAN; 3], [0.0; 3]].into_iter());
        assert_eq!((broken.max, broken.mean, broken.mean_squared), (f64::INFINITY, f64::INFINITY, f64::INFINITY));
        assert_eq!(PictureError::of(std::iter::empty()), PictureError::default());
    }
}
