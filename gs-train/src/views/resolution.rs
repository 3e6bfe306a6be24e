//! Training at a lower resolution first, where steps are cheaper.

use glam::Vec2;
use gs_core::{Camera, Error, Image};
use gs_io::dataset::PosedImage;
use serde::{Deserialize, Serialize};

/// Resolution of the images in the steps of a run.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", rename_all_fields = "kebab-case", deny_unknown_fields)]
#[non_exhaustive]
pub enum Resolution {
    /// Full resolution in all steps.
    #[default]
    Full,
    /// First 1/`from` of the full resolution along each side, then twice that, and so on.
    CoarseToFine {
        /// First divisor: 2, 4 or 8.
        from: u32,
        /// Share of the run after which all steps are at full resolution, 0..=1; the steps before
        /// are shared evenly among the lower resolutions.
        full_after: f32,
    },
}

/// Share of a run after which [`Resolution::from_coarse`] is at full resolution.
const FULL_AFTER: f32 = 0.4;

impl Resolution {
    /// Coarse to fine, starting at 1/`from` of the resolution: 2, 4 or 8, or 1 for full resolution
    /// from the start.
    pub fn from_coarse(from: u32) -> Self {
        if from == 1 { Self::Full } else { Self::CoarseToFine { from, full_after: FULL_AFTER } }
    }

    /// Divisor of the images' sides at `progress` in 0..=1 of the run.
    pub fn factor(self, progress: f32) -> u32 {
        let Self::CoarseToFine { from, full_after } = self else { return 1 };
        if !(progress < full_after) {
            return 1;
        }
        let levels = from.max(1).ilog2();
        let level = ((progress / full_after) * levels as f32) as u32;
        1 << (levels - level.min(levels))
    }

    /// Checks the ranges of all settings.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first value outside its range.
    pub(crate) fn validate(self) -> Result<(), Error> {
        let Self::CoarseToFine { from, full_after } = self else { return Ok(()) };
        if ![2, 4, 8].contains(&from) {
            return Err(Error::setting("resolution.from", from, "2, 4 or 8"));
        }
        Error::within("resolution.full-after", full_after, 0.0..=1.0, "0 to 1")
    }
}

/// The largest of `factor`, `factor`/2, … by which this camera's image can be divided and still has
/// a pixel.
pub(crate) fn possible(camera: &Camera, factor: u32) -> u32 {
    let smallest = camera.width.min(camera.height);
    let mut factor = factor.max(1);
    while factor > 1 && smallest / factor == 0 {
        factor /= 2;
    }
    factor
}

/// The camera of the image whose pixels are means of `factor` × `factor` pixels; remainders at the
/// right and at the bottom are cut off.
pub(crate) fn reduced_camera(camera: &Camera, factor: u32) -> Camera {
    let by = factor as f32;
    Camera {
        focal: camera.focal / by,
        center: Vec2::new(camera.center.x / by, camera.center.y / by),
        width: camera.width / factor,
        height: camera.height / factor,
        ..*camera
    }
}

/// The image for [`reduced_camera`]: means of colours (premultiplied where there is alpha) over the
/// pixels that count. A pixel counts where any of its pixels does.
pub(crate) fn reduced(posed: &PosedImage, factor: u32) -> Result<PosedImage, Error> {
    let PosedImage { image, alpha, mask } = posed;
    let (width, height) = (image.width() / factor, image.height() / factor);
    let stride = image.width() as usize;
    let mut new_alpha = alpha.as_ref().map(|_| Vec::with_capacity((width * height) as usize));
    let mut new_mask = mask.as_ref().map(|_| Vec::with_capacity((width * height) as usize));
    let colors = Image::from_fn(width, height, |x, y| {
        let (mut color, mut opacity, mut counted) = ([0.0f32; 3], 0.0f32, 0u32);
        for row in y * factor..(y + 1) * factor {
            for column in x * factor..(x + 1) * factor {
                let index = row as usize * stride + column as usize;
                if mask.as_ref().is_some_and(|mask| !mask[index]) {
                    continue;
                }
                let a = alpha.as_ref().map_or(1.0, |alpha| alpha[index]);
                let pixel = image.pixels()[index];
                (0..3).for_each(|k| color[k] += a * pixel[k]);
                opacity += a;
                counted += 1;
            }
        }
        if let Some(list) = &mut new_mask {
            list.push(counted > 0);
        }
        if let Some(list) = &mut new_alpha {
            list.push(if counted > 0 { opacity / counted as f32 } else { 0.0 });
        }
        if opacity > 0.0 { color.map(|sum| sum / opacity) } else { [0.0; 3] }
    })?;
    Ok(PosedImage { image: colors, alpha: new_alpha, mask: new_mask })
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn factors_halve_until_the_pictures_are_whole() {
        let schedule = Resolution::CoarseToFine { from: 4, full_after: 0.5 };
        schedule.validate().unwrap();
        let factors = [0.0, 0.2, 0.26, 0.49, 0.5, 1.0].map(|progress| schedule.factor(progress));
        assert_eq!(factors, [4, 4, 2, 2, 1, 1]);
        assert_eq!(Resolution::Full.factor(0.0), 1);
        assert!(Resolution::CoarseToFine { from: 3, full_after: 0.5 }.validate().is_err());
        assert!(Resolution::CoarseToFine { from: 2, full_after: f32::NAN }.validate().is_err());
        assert_eq!(Resolution::CoarseToFine { from: 2, full_after: 0.0 }.factor(0.0), 1);
    }

    #[test]
    fn a_reduced_camera_sees_the_same_in_fewer_pixels() {
        let camera = Camera::looking_forward(41, 30, 1.0);
        let reduced = reduced_camera(&camera, 4);
        assert_eq!((reduced.width, reduced.height), (10, 7));
        let point = Vec3::new(0.3, -0.2, 2.0);
        let (full, _) = camera.project(point).unwrap();
        let (small, _) = reduced.project(point).unwrap();
        assert!((full / 4.0 - small).length() < 1e-5);
        assert_eq!(possible(&camera, 8), 8);
        assert_eq!(possible(&Camera::looking_forward(3, 9, 1.0), 8), 2);
    }

    #[test]
    fn means_are_over_what_is_opaque_and_counts() {
        let image = Image::from_fn(5, 2, |x, _| [x as f32, 1.0, 0.0]).unwrap();
        let plain = reduced(&PosedImage { image: image.clone(), alpha: None, mask: None }, 2).unwrap();
        assert_eq!(plain.image.pixels(), [[0.5, 1.0, 0.0], [2.5, 1.0, 0.0]]);
        let alpha = Some(vec![0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0]);
        let glass = reduced(&PosedImage { image: image.clone(), alpha, mask: None }, 2).unwrap();
        assert_eq!(glass.alpha, Some(vec![0.375, 0.0]));
        assert_eq!(glass.image.pixels(), [[1.0, 1.0, 0.0], [0.0; 3]]);
        let mask = Some(vec![true, false, false, false, true, true, false, false, false, true]);
        let masked = reduced(&PosedImage { image, alpha: None, mask }, 2).unwrap();
        assert_eq!(masked.mask, Some(vec![true, false]));
        assert_eq!(masked.image.pixels()[0], [0.0, 1.0, 0.0]);
    }
}
