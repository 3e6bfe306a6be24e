//! The calibration of a camera, from which follows that of an image of any size.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, dvec2};

use super::{CubeFace, Distortion, Lens, SourceCamera};

/// The calibration of a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Intrinsics {
    pub(crate) focal: Focal,
    /// Principal point, px; by default the centre.
    pub(crate) center: Option<DVec2>,
    /// Columns and rows of the calibration, px; by default those of the image.
    pub(crate) size: Option<DVec2>,
    pub(crate) distortion: Distortion,
    /// Radius of the image circle about the principal point, px of the calibration, if it is stated.
    pub(crate) circle: Option<f64>,
}

impl Intrinsics {
    /// Those of an image of `size` px with these focal lengths, px.
    pub(crate) fn new(focal: DVec2, center: Option<DVec2>, size: DVec2, distortion: Distortion) -> Self {
        Self { focal: Focal::Lengths(focal), center, size: Some(size), distortion, circle: None }
    }

    /// Those of a 360° image of this size.
    pub(crate) fn panorama(size: Option<DVec2>) -> Self {
        let distortion = Distortion::Equirectangular { face: CubeFace::default() };
        Self { focal: Focal::Sphere, center: None, size, distortion, circle: None }
    }

    /// The camera of an image of `width` × `height` px, calibrated at `calibrated` px.
    pub(crate) fn source(&self, calibrated: DVec2, (width, height): (u32, u32), lens: Lens) -> SourceCamera {
        let scale = dvec2(f64::from(width), f64::from(height)) / calibrated;
        let focal = match self.focal {
            Focal::Lengths(focal) => focal,
            Focal::Relative { length, .. } => DVec2::splat(length * calibrated.max_element()),
            Focal::Sphere => calibrated / dvec2(TAU, PI),
            Focal::Angles(x, y) => {
                let length = |side: f64, angle: Option<f64>| angle.map(|angle| 0.5 * side / (0.5 * angle).tan());
                let (x, y) = (length(calibrated.x, x), length(calibrated.y, y));
                dvec2(x.or(y).unwrap_or(f64::NAN), y.or(x).unwrap_or(f64::NAN))
            }
        };
        let center = match self.focal {
            Focal::Relative { offset, .. } => 0.5 * calibrated + offset * calibrated.max_element(),
            _ => self.center.unwrap_or(0.5 * calibrated),
        };
        // The image circle is one in the image as it was calibrated.
        let lens = self.circle.map_or(lens, |radius| lens.within(radius / focal));
        SourceCamera { width, height, focal: focal * scale, center: center * scale, lens }
    }
}

/// The field of view of a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Focal {
    /// Focal lengths, px.
    Lengths(DVec2),
    /// The focal length relative to the longer side of the image, and the principal point from its centre
    /// likewise.
    Relative { length: f64, offset: DVec2 },
    /// Horizontal and vertical angle of view, rad. Without one of them, pixels are square.
    Angles(Option<f64>, Option<f64>),
    /// All directions: 2π over the width, π over the height.
    Sphere,
}
