//! Lens distortion: the camera models of COLMAP, OpenCV and Nerfstudio as maps of the plane.
//!
//! All use *normalised* coordinates: with camera axes right, down, forward, a ray (X, Y, Z), Z > 0,
//! has p = (X/Z, Y/Z). The lens maps it to d, which is the pixel (fx·d.x + cx, fy·d.y + cy). A
//! pinhole has d = p. r = ‖p‖, and θ = atan r is the angle from the optical axis.
//!
//! *Source:* the documentation of COLMAP (`sensor/models`) and OpenCV (`calib3d`), which also
//!   define the parameters.

use glam::{DVec2, dvec2};

use super::cube::CubeFace;

/// The distortion of a lens. Coefficients are dimensionless unless stated otherwise.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) enum Distortion {
    /// No distortion: a pinhole.
    #[default]
    None,
    /// Radial and tangential, in powers of r.
    BrownConrady(BrownConrady),
    /// Devernay and Faugeras 2001: d = p · atan(2 r tan(ω/2)) / (r ω).
    FieldOfView {
        /// ω, rad, between −π and π; 0 is a pinhole.
        omega: f64,
    },
    /// Fitzgibbon 2001: p = d / (1 + k ‖d‖²).
    Division {
        /// k.
        k: f64,
    },
    /// Khomutenko et al. 2016, the enhanced unified camera: d = p / (α √(β r² + 1) + 1 − α).
    EnhancedUnified {
        /// α, 0 to 1.
        alpha: f64,
        /// β, positive.
        beta: f64,
    },
    /// Kannala and Brandt 2006, in powers of θ, with tangential and thin-prism terms.
    Fisheye(Fisheye),
    /// The fish-eye of Project Aria ("Fisheye624"): tangential and prism terms act on the result of
    /// the radial ones.
    AriaFisheye(AriaFisheye),
    /// An equirectangular 360° image, of which a view shows one face of a cube: d is the ray's
    /// longitude and latitude in the image, rad, and p is of the face.
    Equirectangular {
        /// The face.
        face: CubeFace,
    },
}

/// Radial and tangential distortion (Brown 1966, Conrady 1919), as OpenCV has it: d = p · (1 + k₁r²
/// + k₂r⁴ + k₃r⁶ + k₄r⁸) / (1 + m₁r² + m₂r⁴ + m₃r⁶) + (2p₁xy + p₂(r² + 2x²), 2p₂xy + p₁(r² + 2y²)).
///
/// With a skew s, d.x + s d.y takes the place of d.x.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct BrownConrady {
    /// k₁ … k₄; COLMAP and OpenCV have no fourth.
    pub(crate) radial: [f64; 4],
    /// m₁, m₂, m₃: what OpenCV calls k₄, k₅, k₆.
    pub(crate) divisor: [f64; 3],
    /// p₁, p₂.
    pub(crate) tangential: [f64; 2],
    /// s: the skew of the pixels' axes over fx; only Metashape has it.
    pub(crate) skew: f64,
}

/// An equidistant fish-eye: q = p θ/r, then d = q · (1 + k₁θ² + k₂θ⁴ + k₃θ⁶ + k₄θ⁸) + tangential
/// terms of q as in [`BrownConrady`] + (s₁, s₂) θ².
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Fisheye {
    /// k₁ … k₄.
    pub(crate) radial: [f64; 4],
    /// p₁, p₂.
    pub(crate) tangential: [f64; 2],
    /// s₁, s₂: the thin prism (Weng et al. 1992).
    pub(crate) prism: [f64; 2],
}

/// q = p θ/r, t = q · (1 + Σ kᵢ θ²ⁱ), d = t + tangential terms of t as in [`BrownConrady`] + (s₁ρ²
/// + s₂ρ⁴, s₃ρ² + s₄ρ⁴) with ρ = ‖t‖.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct AriaFisheye {
    /// k₁ … k₆.
    pub(crate) radial: [f64; 6],
    /// p₁, p₂ in [`BrownConrady`]'s order, the reverse of COLMAP's.
    pub(crate) tangential: [f64; 2],
    /// s₁ … s₄.
    pub(crate) prism: [f64; 4],
}

/// The plane that a lens's polynomial acts on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Plane {
    /// p itself.
    Tangent,
    /// q = p θ/r.
    Equidistant,
}

impl Distortion {
    /// Whether the coefficients are finite and in range.
    pub(crate) fn is_possible(&self) -> bool {
        let finite = |values: &[f64]| values.iter().all(|v| v.is_finite());
        match self {
            Self::None | Self::Equirectangular { .. } => true,
            Self::BrownConrady(c) => {
                finite(&c.radial) && finite(&c.divisor) && finite(&c.tangential) && c.skew.is_finite()
            }
            Self::FieldOfView { omega } => omega.abs() < std::f64::consts::PI,
            Self::Division { k } => k.is_finite(),
            Self::EnhancedUnified { alpha, beta } => (0.0..=1.0).contains(alpha) && *beta > 0.0 && beta.is_finite(),
            Self::Fisheye(c) => finite(&c.radial) && finite(&c.tangential) && finite(&c.prism),
            Self::AriaFisheye(c) => finite(&c.radial) && finite(&c.tangential) && finite(&c.prism),
        }
    }

    /// The name in calibration programs.
    pub(crate) fn name(&self) -> &'static str {
        match self {
            Self::None => "pinhole",
            Self::BrownConrady(_) => "Brown-Conrady",
            Self::FieldOfView { .. } => "field of view",
            Self::Division { .. } => "division",
            Self::EnhancedUnified { .. } => "enhanced unified",
            Self::Fisheye(_) => "fisheye",
            Self::AriaFisheye(_) => "Aria fisheye",
            Self::Equirectangular { .. } => "equirectangular",
        }
    }

    pub(crate) fn plane(&self) -> Plane {
        match self {
            Self::Fisheye(_) | Self::AriaFisheye(_) => Plane::Equidistant,
            _ => Plane::Tangent,
        }
    }

    /// Maps the plane ([`Plane`]) to d; not finite at poles and outside of the domain.
    pub(crate) fn map(&self, p: DVec2) -> DVec2 {
        let r2 = p.length_squared();
        match self {
            Self::None => p,
            Self::BrownConrady(c) => {
                let d = p * (series(&c.radial, r2) / series(&c.divisor, r2)) + tangential(c.tangential, p);
                dvec2(d.x + c.skew * d.y, d.y)
            }
            Self::FieldOfView { omega } if omega.abs() < 1e-9 => p,
            Self::FieldOfView { omega } => {
                let slope = 2.0 * (0.5 * omega).tan();
                let r = r2.sqrt();
                // The limit of the quotient at the axis.
                p * if r < 1e-9 { slope / omega } else { (r * slope).atan() / (r * omega) }
            }
            Self::Division { k } => p * (2.0 / (1.0 + (1.0 - 4.0 * r2 * k).sqrt())),
            Self::EnhancedUnified { alpha, beta } => p / (alpha * (beta * r2 + 1.0).sqrt() + 1.0 - alpha),
            Self::Equirectangular { face } => face.angles(p),
            Self::Fisheye(c) => {
                p * series(&c.radial, r2) + tangential(c.tangential, p) + DVec2::from_array(c.prism) * r2
            }
            Self::AriaFisheye(c) => {
                let t = p * series(&c.radial, r2);
                let (rho2, [s1, s2, s3, s4]) = (t.length_squared(), c.prism);
                t + tangential(c.tangential, t) + dvec2(s1 + s2 * rho2, s3 + s4 * rho2) * rho2
            }
        }
    }

    /// The inverse of [`Self::map`] in closed form. The outer `None` means that there is none, the
    /// inner that no ray arrives at `d`.
    pub(crate) fn closed_inverse(&self, d: DVec2) -> Option<Option<DVec2>> {
        let r2 = d.length_squared();
        Some(match *self {
            Self::None => Some(d),
            Self::FieldOfView { omega } if omega.abs() < 1e-9 => Some(d),
            Self::FieldOfView { omega } => {
                let (r, slope) = (r2.sqrt(), 2.0 * (0.5 * omega).tan());
                let angle = r * omega;
                let factor = if r < 1e-9 { omega / slope } else { angle.tan() / (r * slope) };
                (angle.abs() < std::f64::consts::FRAC_PI_2).then_some(d * factor)
            }
            Self::Division { k } => {
                let divisor = 1.0 + k * r2;
                // At k‖d‖² = 1 the map folds.
                (divisor > 0.0 && k * r2 <= 1.0).then(|| d / divisor)
            }
            Self::EnhancedUnified { alpha, beta } => {
                let root = (1.0 - (2.0 * alpha - 1.0) * beta * r2).sqrt();
                let depth = (1.0 - alpha * alpha * beta * r2) / (alpha * root + 1.0 - alpha);
                (depth > 0.0).then(|| d / depth)
            }
            Self::Equirectangular { face } => face.ray(d),
            Self::BrownConrady(_) | Self::Fisheye(_) | Self::AriaFisheye(_) => return None,
        })
    }
}

/// 1 + c₁x + c₂x² + …
fn series(coefficients: &[f64], x: f64) -> f64 {
    1.0 + x * coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

/// Decentring: (2p₁xy + p₂(r² + 2x²), 2p₂xy + p₁(r² + 2y²)).
fn tangential([p1, p2]: [f64; 2], p: DVec2) -> DVec2 {
    let (r2, xy) = (p.length_squared(), p.x * p.y);
    dvec2(2.0 * p1 * xy + p2 * (r2 + 2.0 * p.x * p.x), 2.0 * p2 * xy + p1 * (r2 + 2.0 * p.y * p.y))
}
