//! A lens with its distortion and the inverse of it, restricted to where it is one-to-one.
//!
//! A polynomial that was fitted inside the picture can turn round outside of it, so that rays far
//! off the axis fall into the picture a second time. The lens knows where that begins and images
//! nothing beyond.

use std::f64::consts::FRAC_PI_2;

use glam::{DMat2, DVec2};

use super::{
    cube::CubeFace,
    distortion::{Distortion, Plane},
};

/// Largest angle of rays from the axis, rad (89°): a pinhole image would need an infinite plane
/// beyond.
const MAX_ANGLE: f64 = FRAC_PI_2 * 89.0 / 90.0;

/// The same for the faces of a cube around a fish-eye, rad (175°).
const MAX_WIDE_ANGLE: f64 = FRAC_PI_2 * 175.0 / 90.0;

/// Directions in which the angle of an image circle is taken.
const CIRCLE_POINTS: u32 = 64;

/// Share of the areas at the centre below which the lens has folded or is about to: a pixel would
/// be stretched over a hundred.
const MIN_STRETCH: f64 = 0.01;

/// Directions and angles at which the distortion is probed for folds.
const PROBES: (u32, u32) = (16, 512);

/// Bisection steps to find a fold or a radius, to 1e-13 of the interval.
const HALVINGS: u32 = 44;

/// Largest number of steps of Newton's method, which needs 3 to 6.
const MAX_NEWTON_STEPS: u32 = 24;

/// Tolerance of the inverse in normalised coordinates: 1e-7 px at a focal length of 10,000 px.
const INVERSE_TOLERANCE: f64 = 1e-11;

/// A [`Distortion`], restricted to where it is one-to-one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Lens {
    distortion: Distortion,
    /// Largest radius in the distortion's plane for which it is one-to-one.
    limit: f64,
    /// The face of a cube whose rays are meant, instead of those about the axis.
    face: Option<CubeFace>,
}

impl Default for Lens {
    /// A pinhole.
    fn default() -> Self {
        Self { distortion: Distortion::None, limit: MAX_ANGLE.tan(), face: None }
    }
}

impl Lens {
    /// A lens with this distortion; `None` if its coefficients are not possible
    /// ([`Distortion::is_possible`]), or if it is not one-to-one around the axis.
    pub(crate) fn new(distortion: Distortion) -> Option<Self> {
        if !distortion.is_possible() {
            return None;
        }
        let limit = match distortion.closed_inverse(DVec2::ZERO) {
            // Closed forms are monotonic, except a division that ends where 4kr² = 1.
            Some(_) => match distortion {
                Distortion::Division { k } if k > 0.0 => MAX_ANGLE.tan().min(0.5 / k.sqrt()),
                _ => MAX_ANGLE.tan(),
            },
            None => fold(&distortion, MAX_ANGLE),
        };
        (limit > 0.0).then_some(Self { distortion, limit, face: None })
    }

    /// The lens for rays of any direction, of which a face of a cube shows a part: to where it folds,
    /// or to 175° from the axis. Lenses whose formula ends at a right angle stay as they are.
    pub(crate) fn wide(self) -> Self {
        match self.distortion.plane() {
            Plane::Tangent => self,
            Plane::Equidistant => Self { limit: fold(&self.distortion, MAX_WIDE_ANGLE), ..self },
        }
    }

    /// The lens, for rays of a face of the cube around it.
    pub(crate) fn facing(self, face: CubeFace) -> Self {
        Self { face: Some(face), ..self }
    }

    /// The face of a cube around a fish-eye whose rays the lens maps.
    pub(crate) fn cube_face(&self) -> Option<CubeFace> {
        self.face
    }

    /// The lens without what it images outside of an ellipse of these radii in normalised coordinates.
    pub(crate) fn within(self, radii: DVec2) -> Self {
        let direction = |k: u32| DVec2::from_angle(std::f64::consts::TAU * f64::from(k) / f64::from(CIRCLE_POINTS));
        let points = (0..CIRCLE_POINTS).filter_map(|k| self.plane_point(direction(k) * radii));
        Self { limit: points.map(DVec2::length).fold(self.limit, f64::min), ..self }
    }

    /// The distortion.
    pub(crate) fn distortion(&self) -> &Distortion {
        &self.distortion
    }

    /// Whether the lens has no distortion.
    pub(crate) fn is_pinhole(&self) -> bool {
        self.distortion == Distortion::None
    }

    /// Largest usable angle from the axis, rad: where it folds or its image circle ends, or 89° (175° for
    /// the faces of a wide fish-eye).
    pub(crate) fn max_angle(&self) -> f64 {
        match self.distortion.plane() {
            Plane::Tangent => self.limit.atan(),
            Plane::Equidistant => self.limit,
        }
    }

    /// The position of the ray p = (X/Z, Y/Z) in normalised coordinates; `None` beyond
    /// [`Self::max_angle`].
    pub(crate) fn distort(&self, p: DVec2) -> Option<DVec2> {
        let p = match (self.face, self.distortion.plane()) {
            (Some(face), plane) => {
                let ray = face.axes() * p.extend(1.0);
                match plane {
                    Plane::Tangent if !(ray.z > 0.0) => return None,
                    Plane::Tangent => ray.truncate() / ray.z,
                    Plane::Equidistant => {
                        let r = ray.truncate().length();
                        if r < 1e-9 * ray.z { ray.truncate() / ray.z } else { ray.truncate() * (r.atan2(ray.z) / r) }
                    }
                }
            }
            (None, Plane::Tangent) => p,
            (None, Plane::Equidistant) => {
                let r = p.length();
                if r < 1e-9 { p } else { p * (r.atan() / r) }
            }
        };
        // False for NaN.
        if !(p.length_squared() <= self.limit * self.limit) {
            return None;
        }
        let d = self.distortion.map(p);
        d.is_finite().then_some(d)
    }

    /// The ray (X/Z, Y/Z) that arrives at `d`, the inverse of [`Self::distort`]; `None` if there is
    /// none.
    pub(crate) fn undistort(&self, d: DVec2) -> Option<DVec2> {
        let p = self.plane_point(d)?;
        let r = p.length();
        let Some(face) = self.face else {
            return match self.distortion.plane() {
                Plane::Equidistant if r > 1e-9 => Some(p * (r.tan() / r)),
                _ => Some(p),
            };
        };
        let ray = match self.distortion.plane() {
            Plane::Equidistant if r > 1e-9 => (p * (r.sin() / r)).extend(r.cos()),
            _ => p.extend(1.0),
        };
        let ray = face.axes().transpose() * ray;
        (ray.z > 0.0).then(|| ray.truncate() / ray.z)
    }

    /// The point of the distortion's plane that is mapped to `d`.
    fn plane_point(&self, d: DVec2) -> Option<DVec2> {
        if !d.is_finite() {
            return None;
        }
        let p = match self.distortion.closed_inverse(d) {
            Some(p) => p?,
            None => self.solve(d)?,
        };
        (p.length() <= self.limit).then_some(p)
    }

    /// The point of the distortion's plane that is mapped to `d`: bisection along d's direction,
    /// which is exact for a radial lens, then Newton's method.
    fn solve(&self, d: DVec2) -> Option<DVec2> {
        let radius = d.length();
        if radius < 1e-14 {
            return Some(d);
        }
        let direction = d / radius;
        let (mut low, mut high) = (0.0, self.limit);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if self.distortion.map(direction * middle).length() < radius { low = middle } else { high = middle }
        }
        let mut p = direction * (0.5 * (low + high));
        for _ in 0..MAX_NEWTON_STEPS {
            let error = self.distortion.map(p) - d;
            if error.length() <= INVERSE_TOLERANCE {
                return Some(p);
            }
            let step = jacobian(&self.distortion, p).inverse() * error;
            if !step.is_finite() {
                return None;
            }
            p = (p - step).clamp_length_max(self.limit);
        }
        let error = self.distortion.map(p) - d;
        (error.length() <= 100.0 * INVERSE_TOLERANCE).then_some(p)
    }
}

/// The radius at which the distortion first folds in any direction, or that of `max_angle`.
fn fold(distortion: &Distortion, max_angle: f64) -> f64 {
    let radius = |angle: f64| match distortion.plane() {
        Plane::Tangent => angle.tan(),
        Plane::Equidistant => angle,
    };
    let (directions, angles) = PROBES;
    // Two negative stretches, behind a fold too narrow for the probes, have a positive product,
    // too. False for NaN.
    let unfolded = |direction: DVec2, angle: f64| {
        let stretch = jacobian(distortion, direction * radius(angle));
        stretch.determinant() > MIN_STRETCH && stretch.x_axis.x + stretch.y_axis.y > 0.0
    };
    let mut limit = max_angle;
    for k in 0..directions {
        let direction = DVec2::from_angle(std::f64::consts::TAU * f64::from(k) / f64::from(directions));
        let angle = |i: u32| max_angle * f64::from(i) / f64::from(angles);
        let Some(i) = (0..=angles).find(|&i| !unfolded(direction, angle(i))) else { continue };
        if i == 0 {
            return 0.0;
        }
        let (mut low, mut high) = (angle(i - 1), angle(i));
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if unfolded(direction, middle) { low = middle } else { high = middle }
        }
        limit = limit.min(low);
    }
    radius(limit)
}

/// ∂d/∂p by central differences.
fn jacobian(distortion: &Distortion, p: DVec2) -> DMat2 {
    let h = 1e-6 * (1.0 + p.length());
    let along = |axis: DVec2| (distortion.map(p + axis * h) - distortion.map(p - axis * h)) / (2.0 * h);
    DMat2::from_cols(along(DVec2::X), along(DVec2::Y))
}
