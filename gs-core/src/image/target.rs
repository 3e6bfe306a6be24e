//! Target images as a program passes them to a backend.

use super::{Image, rounded_to_8_bits};
use crate::{error::Error, scene::check_len};

/// A target image, with optional alpha, mask and weights.
///
/// An [`Image`] alone converts into an opaque target of which every pixel counts. A backend
/// completes the target in each pass from the background and the rendering of that pass, so that
/// the target is uploaded only once.
#[derive(Debug, Clone, Copy)]
pub struct TargetImage<'a> {
    /// Colours, not premultiplied.
    pub image: &'a Image,
    /// Alpha of each pixel, `[height · width]`, row-major, 0..=1; below 1 the background of the
    /// pass shows: c·α + background·(1 − α). `None` where all are 1.
    pub alpha: Option<&'a [f32]>,
    /// Whether each pixel counts, `[height · width]`, row-major; `None` where all do.
    ///
    /// Pixels that do not count are replaced by the rendering, so they add nothing to the loss and
    /// have no gradient. The loss stays a mean over all pixels.
    pub mask: Option<&'a [bool]>,
    /// How much each pixel counts, `[height · width]`, row-major, not negative; `None` where all
    /// count 1.
    ///
    /// They are factors of the losses of pixels under L1 and L2, and of their gradients. The loss
    /// stays a mean over all pixels. Backends refuse them under D-SSIM, which is not a sum over
    /// pixels. The statistic [`Statistics::PixelError`](crate::effects::Statistics::PixelError)
    /// leaves them out.
    pub weights: Option<&'a [f32]>,
    /// Whether memory counts more than time, as where a target is one of many: a backend may then
    /// keep 8-bit colours as such, and compute in each pass what it could keep. Results are the
    /// same, up to rounding where the backend then fuses no stages.
    pub compact: bool,
}

impl<'a> From<&'a Image> for TargetImage<'a> {
    fn from(image: &'a Image) -> Self {
        Self { image, alpha: None, mask: None, weights: None, compact: false }
    }
}

impl TargetImage<'_> {
    /// Checks that all colours are finite, all alphas within 0..=1, all weights finite and not
    /// negative, and each of the three as long as the image.
    ///
    /// # Errors
    /// [`Error::Pixel`], [`Error::Setting`] or [`Error::Length`], naming the first fault.
    pub fn validate(&self) -> Result<(), Error> {
        self.image.check_finite("the target")?;
        let expected = self.image.pixels().len();
        let [alpha, weights] = [self.alpha, self.weights].map(|numbers| numbers.map(<[f32]>::len));
        for (what, found) in [("alpha", alpha), ("mask", self.mask.map(<[bool]>::len)), ("weights", weights)] {
            check_len(what, expected, found.unwrap_or(expected))?;
        }
        if let Some(alpha) = self.alpha.and_then(|alpha| alpha.iter().find(|alpha| !(0.0..=1.0).contains(*alpha))) {
            return Err(Error::setting("a target's alpha", alpha, "0 to 1"));
        }
        let is_weight = |weight: &f32| *weight >= 0.0 && weight.is_finite();
        match self.weights.and_then(|weights| weights.iter().find(|weight| !is_weight(weight))) {
            Some(weight) => Err(Error::setting("the weight of a pixel", weight, "not negative and finite")),
            None => Ok(()),
        }
    }

    /// Whether each colour and each alpha is one of the 256 values that an 8-bit file holds.
    pub fn is_8_bit(&self) -> bool {
        let is_level = |value: &f32| rounded_to_8_bits(*value).to_bits() == value.to_bits();
        let colors = self.image.pixels().as_flattened();
        colors.iter().chain(self.alpha.into_iter().flatten()).all(is_level)
    }

    /// Alpha of each pixel, or −1 where it does not count, for [`completed`]. `None` where all
    /// pixels are opaque and count.
    pub fn coverage(&self) -> Option<Vec<f32>> {
        if self.alpha.is_none() && self.mask.is_none() {
            return None;
        }
        let coverage = |index: usize| match self.mask {
            Some(mask) if !mask[index] => -1.0,
            _ => self.alpha.map_or(1.0, |alpha| alpha[index]),
        };
        Some((0..self.image.pixels().len()).map(coverage).collect())
    }
}

/// A channel of a target's pixel, completed with the background or the rendering; for `coverage`
/// see [`TargetImage::coverage`].
#[inline(always)]
pub fn completed(target: f32, coverage: f32, background: f32, rendered: f32) -> f32 {
    if coverage < 0.0 {
        rendered
    } else if coverage < 1.0 {
        target * coverage + background * (1.0 - coverage)
    } else {
        target
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_and_alphas_are_as_long_as_their_image() {
        let image = Image::filled(2, 1, [0.5; 3]).unwrap();
        let plain = TargetImage::from(&image);
        plain.validate().unwrap();
        assert_eq!(plain.coverage(), None);
        let both = TargetImage { alpha: Some(&[0.25, 0.5]), mask: Some(&[true, false]), ..plain };
        both.validate().unwrap();
        assert_eq!(both.coverage(), Some(vec![0.25, -1.0]));
        let short = TargetImage { mask: Some(&[true]), ..plain };
        assert!(matches!(short.validate(), Err(Error::Length { what: "mask", expected: 2, found: 1 })));
        let short = TargetImage { alpha: Some(&[1.0; 3]), ..plain };
        assert!(matches!(short.validate(), Err(Error::Length { what: "alpha", expected: 2, found: 3 })));
        let wrong = TargetImage { alpha: Some(&[0.5, f32::NAN]), ..plain };
        assert!(matches!(wrong.validate(), Err(Error::Setting { .. })));
        let short = TargetImage { weights: Some(&[1.0; 3]), ..plain };
        assert!(matches!(short.validate(), Err(Error::Length { what: "weights", expected: 2, found: 3 })));
        for weight in [-1.0, f32::NAN, f32::INFINITY] {
            let wrong = TargetImage { weights: Some(&[weight, 1.0]), ..plain };
            assert!(matches!(wrong.validate(), Err(Error::Setting { .. })), "{weight}");
        }
        TargetImage { weights: Some(&[0.0, 7.5]), ..plain }.validate().unwrap();
    }

    #[test]
    fn values_of_8_bit_files_are_found() {
        let image = Image::from_pixels(2, 1, vec![[0.0, 1.0, 100.0 / 255.0], [0.2; 3]]).unwrap();
        let with_alpha = |alpha| TargetImage { alpha: Some(alpha), ..TargetImage::from(&image) };
        assert!(TargetImage::from(&image).is_8_bit());
        assert!(with_alpha(&[0.0, 1.0]).is_8_bit());
        assert!(!with_alpha(&[0.0, 0.5]).is_8_bit());
        assert!(!TargetImage::from(&Image::filled(1, 1, [0.3 + 1e-6; 3]).unwrap()).is_8_bit());
    }

    #[test]
    fn pixels_that_do_not_count_are_as_rendered() {
        assert_eq!(completed(0.75, -1.0, 0.5, 0.25), 0.25);
        assert_eq!(completed(0.75, 1.0, 0.5, 0.25), 0.75);
        assert_eq!(completed(0.75, 0.5, 0.25, 0.0), 0.5);
    }
}
