//! An image to compare with, as a program hands it to a backend.

use crate::{error::Error, image::Image};

/// An image to compare with, and which of its pixels count.
///
/// An [`Image`] alone converts into one that is opaque and of which every pixel counts. A backend completes the image in each pass, from
/// the background and the rendering of that pass, so that neither crosses to the device again.
#[derive(Debug, Clone, Copy)]
pub struct TargetImage<'a> {
    /// The colours, not premultiplied.
    pub image: &'a Image,
    /// The pixels' opacities, `[height · width]`, row-major, 0..=1; where one is below 1, the pass's background shows:
    /// c·α + background·(1 − α). `None` where all are 1.
    pub alpha: Option<&'a [f32]>,
    /// Which pixels count, `[height · width]`, row-major. The others are taken to be as they are rendered, so that they add nothing to the
    /// loss and pull at nothing; the loss stays a mean over all pixels. `None` where all count.
    pub mask: Option<&'a [bool]>,
}

impl<'a> From<&'a Image> for TargetImage<'a> {
    fn from(image: &'a Image) -> Self {
        Self { image, alpha: None, mask: None }
    }
}

impl TargetImage<'_> {
    /// Fails unless all colours are finite, all opacities within 0..=1, and alpha and mask as long as the image.
    ///
    /// # Errors
    /// [`Error::Pixel`], [`Error::Setting`] or [`Error::Length`], naming the first offender.
    pub fn validate(&self) -> Result<(), Error> {
        self.image.check_finite("the target")?;
        let expected = self.image.pixels().len();
        let lengths = [("alpha", self.alpha.map(<[f32]>::len)), ("mask", self.mask.map(<[bool]>::len))];
        for (what, found) in lengths {
            if let Some(found) = found.filter(|&found| found != expected) {
                return Err(Error::Length { what, expected, found });
            }
        }
        match self.alpha.and_then(|alpha| alpha.iter().find(|alpha| !(0.0..=1.0).contains(*alpha))) {
            Some(&alpha) => Err(Error::setting("a target's alpha", alpha, "0 to 1")),
            None => Ok(()),
        }
    }

    /// What a backend needs beside the colours to complete the target: for each pixel its alpha, or −1 where it does not count. `None`
    /// where the colours are complete.
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

/// A pixel of a target, completed: `coverage` is as [`TargetImage::coverage`] has it.
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
    }

    #[test]
    fn pixels_that_do_not_count_are_as_rendered() {
        assert_eq!(completed(0.75, -1.0, 0.5, 0.25), 0.25);
        assert_eq!(completed(0.75, 1.0, 0.5, 0.25), 0.75);
        assert_eq!(completed(0.75, 0.5, 0.25, 0.0), 0.5);
    }
}
