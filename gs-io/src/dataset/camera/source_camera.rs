//! The camera of an image file with its lens, and the pinhole camera of the undistorted picture.

use glam::{DVec2, dvec2};
use gs_core::constants::MAX_SIDE_PX;

use super::{
    Distortion,
    cube::{self, CubeFace},
    lens::Lens,
};

/// How far an undistorted picture may extend beyond the image's frame or stay within it on each
/// side, relative to the frame's side: twice to a fifth in total, the limits of COLMAP's
/// undistortion.
const SIDE_RANGE: (f64, f64) = (-0.5, 0.4);

/// Range of possible focal lengths, relative to the image's longer side: angles of view from 20 arc
/// seconds to 178.9 degrees.
const FOCAL_RANGE: (f64, f64) = (0.01, 1e4);

/// Largest distance of the principal point from the image's centre, relative to the image's longer
/// side. It is outside of the image for cut-outs only.
const CENTER_RANGE: f64 = 100.0;

/// Distance from the axis at which a lens is checked, relative to the image's longer side; and the
/// largest factor by which it may move a pixel there.
const NEAR_AXIS: f64 = 0.05;
const STRETCH: f64 = 10.0;

/// Points that are checked on each border of the image.
const BORDER_POINTS: u32 = 256;

/// The camera of an image file, with intrinsics for its real size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SourceCamera {
    /// Columns of the image.
    pub width: u32,
    /// Rows of the image.
    pub height: u32,
    /// Focal lengths (fx, fy), px.
    pub focal: DVec2,
    /// Principal point (cx, cy), px from the top-left corner; pixel (i, j) has its centre at (i +
    /// ½, j + ½), as in COLMAP.
    pub center: DVec2,
    /// How the lens bends rays.
    pub(crate) lens: Lens,
}

impl SourceCamera {
    /// The pixel of the ray (X/Z, Y/Z), inside the frame or not; `None` if the lens does not image
    /// it.
    pub fn to_pixel(&self, ray: DVec2) -> Option<DVec2> {
        self.lens.distort(ray).map(|d| d * self.focal + self.center)
    }

    /// The ray (X/Z, Y/Z) of a pixel; `None` if there is none.
    pub fn to_ray(&self, pixel: DVec2) -> Option<DVec2> {
        self.lens.undistort((pixel - self.center) / self.focal)
    }

    /// The pinhole camera of the undistorted picture: the same focal lengths, and the largest frame
    /// in which every pixel comes from the image (COLMAP with `blank_pixels` = 0, OpenCV with alpha
    /// = 0), limited to between a fifth and twice the image's sides. For a pinhole, the camera
    /// itself; for a 360° image, its face of 90°, with a quarter of the image's width; for a wide
    /// fish-eye, its face of 90°, with twice the focal length.
    pub fn pinhole(&self) -> Self {
        if self.lens.is_pinhole() {
            return *self;
        }
        if self.face().is_some() {
            // The face of a fish-eye has the resolution of the image at its middle.
            let side = match self.is_panorama() {
                true => cube::face_side(self.width),
                false => self.focal.element_sum().round().clamp(1.0, f64::from(MAX_SIDE_PX)) as u32,
            };
            let half = DVec2::splat(0.5 * f64::from(side));
            return Self { width: side, height: side, focal: half, center: half, lens: Lens::default() };
        }
        let size = self.size();
        let (low, high) = self.seen();
        let low = low.min(size * SIDE_RANGE.1);
        let high = high.max(size * (1.0 - SIDE_RANGE.1));
        // A fraction of a pixel is no column; it is shared by both sides.
        let sides = (high - low + 1e-6).floor().clamp(DVec2::ONE, DVec2::splat(f64::from(MAX_SIDE_PX)));
        let corner = low + 0.5 * (high - low - sides);
        let (width, height) = (sides.x as u32, sides.y as u32);
        Self { width, height, focal: self.focal, center: self.center - corner, lens: Lens::default() }
    }

    /// Why the camera is impossible, in words: focal length or principal point beyond any camera's,
    /// or a lens that shows less than a fifth of the image's width or height.
    pub(crate) fn fault(&self) -> Option<String> {
        let (size, longer) = (self.size(), self.size().max_element());
        let of = format!("for an image of {}x{} px", self.width, self.height);
        let shares = self.focal / longer;
        // True for NaN, which min_element and max_element may pass over.
        let in_range = |share: f64| (FOCAL_RANGE.0..=FOCAL_RANGE.1).contains(&share);
        if !(in_range(shares.x) && in_range(shares.y)) {
            let DVec2 { x, y } = self.focal;
            return Some(format!("focal lengths of {x:e} and {y:e} px {of}"));
        }
        if !(self.center - 0.5 * size).abs().cmple(DVec2::splat(CENTER_RANGE * longer)).all() {
            let DVec2 { x, y } = self.center;
            return Some(format!("a principal point at {x:e}, {y:e} px {of}"));
        }
        if self.lens.is_pinhole() || self.face().is_some() {
            return None;
        }
        let (low, high) = self.seen();
        let least = 1.0 - 2.0 * SIDE_RANGE.1;
        let shows_enough = ((high - low) / size).cmpge(DVec2::splat(least - 1e-9)).all();
        // Checked near the axis first: with an extreme lens, the borders of the picture may not be
        // found.
        let sane = [DVec2::X, DVec2::NEG_X, DVec2::Y, DVec2::NEG_Y].into_iter().all(|direction| {
            let away = NEAR_AXIS * longer;
            let pixel = self.lens.distort(direction * away / self.focal).map(|d| (d * self.focal).length());
            pixel.is_some_and(|pixel| (away / STRETCH..=away * STRETCH).contains(&pixel))
        });
        (!(sane && shows_enough)).then(|| format!("a lens that shows less than a fifth of the width or height {of}"))
    }

    /// The name of the lens in calibration programs; "pinhole" without distortion.
    pub fn lens_name(&self) -> &'static str {
        self.lens.distortion().name()
    }

    /// Whether a view shows a face of the cube around a 360° camera or a wide fish-eye.
    pub fn is_face(&self) -> bool {
        self.face().is_some()
    }

    /// The face of the cube that a view of a 360° image or of a wide fish-eye shows; `None` for other
    /// images.
    pub(crate) fn face(&self) -> Option<CubeFace> {
        match *self.lens.distortion() {
            Distortion::Equirectangular { face } => Some(face),
            _ => self.lens.cube_face(),
        }
    }

    /// Whether the image is a 360° image.
    pub fn is_panorama(&self) -> bool {
        matches!(self.lens.distortion(), Distortion::Equirectangular { .. })
    }

    /// The camera of the front face, which stands for all faces of its image; otherwise the camera itself.
    pub fn front(&self) -> Self {
        let lens = match (self.face(), self.is_panorama()) {
            (None, _) => self.lens,
            (Some(_), false) => self.lens.facing(CubeFace::Front),
            (Some(_), true) => Lens::new(Distortion::Equirectangular { face: CubeFace::Front }).unwrap_or(self.lens),
        };
        Self { lens, ..*self }
    }

    /// Whether the image shows this ray.
    pub(crate) fn shows(&self, ray: DVec2) -> bool {
        self.to_pixel(ray).is_some_and(|pixel| pixel.cmpge(DVec2::ZERO).all() && pixel.cmple(self.size()).all())
    }

    fn size(&self) -> DVec2 {
        dvec2(f64::from(self.width), f64::from(self.height))
    }

    /// Opposite corners of the largest frame, in the plane of the undistorted picture, in which
    /// every pixel comes from the image; at most twice as large as the image.
    fn seen(&self) -> (DVec2, DVec2) {
        let size = self.size();
        // Nothing is visible beyond the largest angle.
        let reach = self.lens.max_angle().tan() * self.focal;
        let mut low = (size * SIDE_RANGE.0).max(self.center - reach);
        let mut high = (size * (1.0 - SIDE_RANGE.0)).min(self.center + reach);
        // Where a border of the image lies in the plane of the picture. A border too far off the
        // axis does not limit the frame.
        let seen = |x: f64, y: f64| self.to_ray(dvec2(x, y)).map(|ray| ray * self.focal + self.center);
        for k in 0..=BORDER_POINTS {
            let along = size * (f64::from(k) / f64::from(BORDER_POINTS));
            let side = |point: Option<DVec2>, axis: fn(DVec2) -> f64| point.map(axis);
            low.x = side(seen(0.0, along.y), |p| p.x).map_or(low.x, |x| low.x.max(x));
            low.y = side(seen(along.x, 0.0), |p| p.y).map_or(low.y, |y| low.y.max(y));
            high.x = side(seen(size.x, along.y), |p| p.x).map_or(high.x, |x| high.x.min(x));
            high.y = side(seen(along.x, size.y), |p| p.y).map_or(high.y, |y| high.y.min(y));
        }
        (low, high)
    }
}
