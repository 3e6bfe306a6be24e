//! A lens with its distortion and the inverse of it, restricted to where it is one-to-one.
//!
//! A polynomial that was fitted inside the picture can turn round outside of it, so that rays far
//! off the axis fall into the picture a second time. The lens knows where that begins and images
//! nothing beyond.

use std::f64::consts::FRAC_PI_2;

use glam::{DMat2, DVec2};

use super::distortion::{Distortion, Plane};

/// Largest angle of rays from the axis, rad (89°): a pinhole image would need an infinite plane
/// beyond.
const MAX_ANGLE: f64 = FRAC_PI_2 * 89.0 / 90.0;

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
pub struct Lens {
    distortion: Distortion,
    /// Largest radius in the distortion's plane for which it is one-to-one.
    limit: f64,
}

impl Default for Lens {
    /// A pinhole.
    fn default() -> Self {
        Self { distortion: Distortion::None, limit: MAX_ANGLE.tan() }
    }
}

impl Lens {
    /// A lens with this distortion; `None` if its coefficients are not possible
    /// ([`Distortion::is_possible`]), or if it is not one-to-one around the axis.
    pub fn new(distortion: Distortion) -> Option<Self> {
        if !distortion.is_possible() {
            return None;
        }
        let limit = match distortion.closed_inverse(DVec2::ZERO) {
            // Closed forms are monotonic, except a division that ends where 4kr² = 1.
            Some(_) => match distortion {
                Distortion::Division { k } if k > 0.0 => MAX_ANGLE.tan().min(0.5 / k.sqrt()),
                _ => MAX_ANGLE.tan(),
            },
            None => fold(&distortion),
        };
        (limit > 0.0).then_some(Self { distortion, limit })
    }

    /// The distortion.
    pub fn distortion(&self) -> &Distortion {
        &self.distortion
    }

    /// Whether the lens has no distortion.
    pub fn is_pinhole(&self) -> bool {
        self.distortion == Distortion::None
    }

    /// Largest usable angle from the axis, rad: where it folds, or 89°.
    pub fn max_angle(&self) -> f64 {
        match self.distortion.plane() {
            Plane::Tangent => self.limit.atan(),
            Plane::Equidistant => self.limit,
        }
    }

    /// The position of the ray p = (X/Z, Y/Z) in normalised coordinates; `None` beyond
    /// [`Self::max_angle`].
    pub fn distort(&self, p: DVec2) -> Option<DVec2> {
        let p = match self.distortion.plane() {
            Plane::Tangent => p,
            Plane::Equidistant => {
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
    pub fn undistort(&self, d: DVec2) -> Option<DVec2> {
        if !d.is_finite() {
            return None;
        }
        let p = match self.distortion.closed_inverse(d) {
            Some(p) => p?,
            None => self.solve(d)?,
        };
        let r = p.length();
        if !(r <= self.limit) {
            return None;
        }
        match self.distortion.plane() {
            Plane::Equidistant if r > 1e-9 => Some(p * (r.tan() / r)),
            _ => Some(p),
        }
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

/// The radius at which the distortion first folds in any direction, or that of [`MAX_ANGLE`].
fn fold(distortion: &Distortion) -> f64 {
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
    let mut limit = MAX_ANGLE;
    for k in 0..directions {
        let direction = DVec2::from_angle(std::f64::consts::TAU * f64::from(k) / f64::from(directions));
        let angle = |i: u32| MAX_ANGLE * f64::from(i) / f64::from(angles);
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
