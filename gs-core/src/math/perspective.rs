//! Projection of a 3D Gaussian through a camera (paper eq. 3–5), and the gradients back through it:
//! the reference that every backend computes.
//!
//! With p = W μ + t and M = R(q/|q|) S, the Gaussian projects to M′ = J W M (2×3), Σ′ = M′ M′ᵀ + δ
//! I. J is the Jacobian at p, with slopes x/z and y/z clamped a little beyond the image
//! ([`JACOBIAN_MARGIN`]). det Σ is the sum of the squares of the three minors of M′ (Cauchy–Binet),
//! which does not cancel as Σxx Σyy − Σxy² does in needles.
//!
//! A Gaussian that is left out is counted under the first cause that applies: a parameter is not
//! finite; its mean is nearer than the near plane; its quaternion has no direction; its mean or
//! covariance is not finite; det Σ′ is too small; it is transparent; and then, found by the
//! backend, it touches no pixel, or its colour is not finite.
//!
//! Legend: s = slopes (x/z, y/z), t = s clamped, m₀ m₁ m₂ = rows of W M, r₀ r₁ = rows of M′, n = r₀
//! × r₁ the minors, D = det Σ, D′ = det Σ′, ρ = √(D/D′) the compensation of the opacity
//! ([`Antialias::compensates`]), `v_x` = ∂L/∂x.

mod camera;
mod splitting;

use glam::{Mat3, Quat, Vec2, Vec3};

use crate::{
    constants::{JACOBIAN_MARGIN, MIN_DETERMINANT_PX4, MIN_QUATERNION_NORM2, QUATERNION_SHRINK, SAFE_SQUARES},
    effects::{Antialias, Blend},
    scene::sigmoid,
    settings::RenderSettings,
    training::CullCause,
    view::Camera,
};

pub use self::splitting::LEAST_LOG_RATIO;

/// Parameters of a 3D Gaussian without its colour, or ∂L/∂ each of them; units as in
/// [`Scene3d`](crate::Scene3d).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Ellipsoid {
    /// μ, world units.
    pub mean: Vec3,
    /// ln(world units).
    pub log_scale: Vec3,
    /// q = (w, x, y, z), of any length but 0.
    pub rotation: [f32; 4],
    /// Logit of the opacity.
    pub opacity_logit: f32,
}

impl Ellipsoid {
    /// R(q/|q|) S, a factor of Σ (paper eq. 5), world units. `None` where q is too short to have a
    /// direction ([`MIN_QUATERNION_NORM2`]).
    pub fn factor(&self) -> Option<Mat3> {
        let Quaternion { scaled: [w, x, y, z], norm2, .. } = Quaternion::new(self.rotation);
        let rotation = (norm2 >= MIN_QUATERNION_NORM2).then(|| Quat::from_xyzw(x, y, z, w).normalize())?;
        Some(Mat3::from_quat(rotation) * Mat3::from_diagonal(self.log_scale.map(f32::exp)))
    }
}

/// A projected Gaussian, without its colour.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projection {
    /// Mean on the image, px.
    pub mean: Vec2,
    /// z of the mean, world units.
    pub depth: f32,
    /// Σ′: xx, xy, yy, px².
    pub covariance: [f32; 3],
    /// det Σ′, px⁴.
    pub determinant: f32,
    /// o: the sigmoid of the logit, times ρ where [`Antialias::compensates`] and times
    /// 1 / (1 − rate) of [`Dropout`](crate::Dropout), which may raise it above 1. It is 1 under
    /// [`Blend::Sum`].
    pub opacity: f32,
    /// cov(z, (u, v)) Σ′⁻¹, world units per px; it orders Gaussians under
    /// [`Order::PerPixel`](crate::effects::Order::PerPixel) and has no gradient.
    ///
    /// At a pixel whose centre is d away from the mean, the mean of z given that the ray goes
    /// through the pixel is `depth` + `depth_slope` · d (compare RaDe-GS and StopThePop; exact for
    /// the affine approximation).
    pub depth_slope: Vec2,
}

/// ∂L/∂ the fields of a [`Projection`], as sums over the pixels.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ProjectionGradient {
    /// ∂L/∂mean, px⁻¹.
    pub mean: Vec2,
    /// ∂L/∂Σ′xx; ∂L/∂Σ′xy (the same for Σ′yx); ∂L/∂Σ′yy. px⁻².
    pub covariance: [f32; 3],
    /// ∂L/∂(ln o): the sum over the pixels of o·∂L/∂o.
    pub log_opacity: f32,
}

/// A camera with the effects that act on one Gaussian, made once per forward pass.
#[derive(Debug, Clone, Copy)]
pub struct Perspective {
    rotation: Mat3,
    translation: Vec3,
    position: Vec3,
    focal: Vec2,
    center: Vec2,
    near: f32,
    /// Bounds of the Jacobian's slopes.
    slopes: [Vec2; 2],
    dilation: f32,
    antialias: Antialias,
    blend: Blend,
    alpha_cut: f32,
    /// [`Dropout::gain`](crate::Dropout::gain), by which opacities are multiplied.
    gain: f32,
}

/// Values that projection and its VJP share.
struct Intermediate {
    /// r₀, r₁.
    projected: [Vec3; 2],
    inverse_z: f32,
    slope: Vec2,
    clamped: Vec2,
}

/// The part of the VJP up to the rows m₀, m₁, m₂.
struct Returned {
    /// ∂L/∂p.
    v_p: Vec3,
    /// r₀, r₁, and ∂L/∂each.
    projected: [Vec3; 2],
    v_projected: [Vec3; 2],
    /// ∂L/∂(m₀, m₁, m₂).
    v_rows: [Vec3; 3],
    /// ∂L/∂(opacity logit).
    opacity_logit: f32,
}

/// A quaternion scaled by a power of two that keeps its square finite, and that square.
#[derive(Debug, Clone, Copy)]
struct Quaternion {
    scaled: [f32; 4],
    /// |scaled|²; NaN or infinite where a component of q is.
    norm2: f32,
    /// 1 or [`QUATERNION_SHRINK`].
    scale: f32,
}

/// A rotation and the quaternion that it is made of.
struct Turned {
    /// R(q/|q|).
    rotation: Mat3,
    /// q/|q| and 1/|q|.
    unit: [f32; 4],
    inverse_norm: f32,
}

impl Perspective {
    /// The perspective of a valid camera with valid settings.
    pub fn new(camera: &Camera, settings: &RenderSettings) -> Self {
        let size = Vec2::new(camera.width as f32, camera.height as f32);
        let margin = JACOBIAN_MARGIN * 0.5 * size / camera.focal;
        let effects = &settings.effects;
        Self {
            rotation: camera.rotation,
            translation: camera.translation,
            position: camera.position(),
            focal: camera.focal,
            center: camera.center,
            near: camera.near,
            slopes: [-(camera.center / camera.focal) - margin, (size - camera.center) / camera.focal + margin],
            dilation: effects.antialias.dilation(),
            antialias: effects.antialias,
            blend: effects.blend,
            alpha_cut: settings.accuracy.alpha_cut,
            gain: settings.dropout.gain(),
        }
    }

    /// The least and the greatest slopes (x/z, y/z) of the Jacobian, for backends whose kernels
    /// clamp themselves.
    pub fn slopes(&self) -> [Vec2; 2] {
        self.slopes
    }

    /// Projects a Gaussian.
    ///
    /// # Errors
    /// The first [`CullCause`] that applies.
    #[inline]
    pub fn project(&self, g: &Ellipsoid) -> Result<Projection, CullCause> {
        let quaternion = Quaternion::new(g.rotation);
        // A sum is finite only if all its terms are.
        let finite = g.mean.is_finite() && g.log_scale.is_finite() && quaternion.norm2.is_finite();
        if !finite || g.opacity_logit.is_nan() {
            return Err(CullCause::NotFinite);
        }
        let p = self.in_front(g.mean)?;
        if !(quaternion.norm2 >= MIN_QUATERNION_NORM2) {
            return Err(CullCause::Degenerate);
        }
        self.project_rows(p, self.rows(&turned(&quaternion).rotation, g.log_scale), g.opacity_logit)
    }

    /// ∂L/∂(mean, log-scale, rotation, opacity logit) of a Gaussian that [`Self::project`] accepts,
    /// without the part through its colour. The gradient by q is orthogonal to q.
    #[inline]
    pub fn project_vjp(&self, g: &Ellipsoid, v: &ProjectionGradient) -> Ellipsoid {
        let p = self.rotation * g.mean + self.translation;
        let turned = turned(&Quaternion::new(g.rotation));
        let rows = self.rows(&turned.rotation, g.log_scale);
        let Returned { v_p, projected: [r0, r1], v_projected: [v_r0, v_r1], v_rows, opacity_logit } =
            self.project_rows_vjp(p, &rows, g.opacity_logit, v);
        let to_world = self.rotation.transpose();
        Ellipsoid {
            mean: to_world * v_p,
            log_scale: v_r0 * r0 + v_r1 * r1,
            rotation: quaternion_vjp(turned.unit, turned.inverse_norm, to_world * turn_vjp(&rows, &v_rows)),
            opacity_logit,
        }
    }

    /// z of a mean, world units.
    #[inline]
    pub fn depth(&self, mean: Vec3) -> f32 {
        (self.rotation * mean + self.translation).z
    }

    /// p of a finite mean, or the cause that culls it.
    #[inline(always)]
    fn in_front(&self, mean: Vec3) -> Result<Vec3, CullCause> {
        let p = self.rotation * mean + self.translation;
        if p.is_nan() {
            return Err(CullCause::NotFinite);
        }
        if !(p.z >= self.near) {
            return Err(CullCause::Near);
        }
        Ok(p)
    }

    #[inline(always)]
    fn project_rows(&self, p: Vec3, rows: [Vec3; 3], opacity_logit: f32) -> Result<Projection, CullCause> {
        let Intermediate { projected: [r0, r1], slope, .. } = self.intermediate(p, &rows);
        let mean = self.focal * slope + self.center;
        let delta = self.dilation;
        let (xx, yy, xy) = (r0.length_squared(), r1.length_squared(), r0.dot(r1));
        let minors = r0.cross(r1);
        let undilated = minors.length_squared();
        let determinant = undilated + delta * (xx + yy) + delta * delta;
        let (xx, yy) = (xx + delta, yy + delta);
        let finite = mean.is_finite() && (xx * yy).is_finite() && determinant.is_finite();
        if !finite {
            return Err(CullCause::NotFinite);
        }
        if !(determinant >= MIN_DETERMINANT_PX4) {
            return Err(CullCause::Degenerate);
        }
        let opacity = match (self.blend, self.antialias) {
            (Blend::Sum, _) => 1.0,
            (Blend::Over, antialias) if antialias.compensates() => {
                sigmoid(opacity_logit) * (undilated / determinant).sqrt() * self.gain
            }
            (Blend::Over, _) => sigmoid(opacity_logit) * self.gain,
        };
        if !(opacity >= self.alpha_cut) {
            return Err(CullCause::Transparent);
        }
        let (zu, zv) = (rows[2].dot(r0), rows[2].dot(r1));
        // z̃u Σyy − z̃v Σxy = m₂ · (r₁ × n), without the difference, which cancels in needles; and
        // so for v.
        let undilated_slope = Vec2::new(rows[2].dot(r1.cross(minors)), rows[2].dot(minors.cross(r0)));
        let depth_slope = (undilated_slope + delta * Vec2::new(zu, zv)) / determinant;
        Ok(Projection { mean, depth: p.z, covariance: [xx, xy, yy], determinant, opacity, depth_slope })
    }

    #[inline(always)]
    fn project_rows_vjp(&self, p: Vec3, rows: &[Vec3; 3], opacity_logit: f32, v: &ProjectionGradient) -> Returned {
        let Intermediate { projected: [r0, r1], inverse_z, slope, clamped } = self.intermediate(p, rows);
        let m2 = rows[2];
        let [v_xx, v_xy, v_yy] = v.covariance;
        let mut v_r0 = 2.0 * (v_xx * r0 + v_xy * r1);
        let mut v_r1 = 2.0 * (v_xy * r0 + v_yy * r1);
        if self.antialias.compensates() && self.blend == Blend::Over {
            // ln ρ = ½ (ln D − ln D′), D = |n|², D′ = D + δ (|r₀|² + |r₁|²) + δ².
            let n = r0.cross(r1);
            let (det, trace, delta) = (n.length_squared(), r0.length_squared() + r1.length_squared(), self.dilation);
            // Drawn Gaussians have ρ ≥ the α cut, so D > 0; Gaussians that are not drawn have no
            // gradient.
            if det > 0.0 {
                let grown = delta * trace + delta * delta;
                let (by_minors, by_trace) = (grown / (det * (det + grown)), delta / (det + grown));
                v_r0 += v.log_opacity * (by_minors * r1.cross(n) - by_trace * r0);
                v_r1 += v.log_opacity * (by_minors * n.cross(r0) - by_trace * r1);
            }
        }
        // r₀ = fx/z (m₀ − tx m₂), r₁ = fy/z (m₁ − ty m₂).
        let scale = self.focal * inverse_z;
        let (v_m0, v_m1) = (scale.x * v_r0, scale.y * v_r1);
        let v_m2 = -(clamped.x * v_m0 + clamped.y * v_m1);
        let v_clamped = -Vec2::new(v_m0.dot(m2), v_m1.dot(m2));
        let v_slope = self.focal * v.mean + Vec2::select(slope.cmpeq(clamped), v_clamped, Vec2::ZERO);
        let v_depth = -inverse_z * (v_slope.dot(slope) + v_r0.dot(r0) + v_r1.dot(r1));
        let opacity_logit = match self.blend {
            Blend::Sum => 0.0,
            Blend::Over => v.log_opacity * sigmoid(-opacity_logit),
        };
        Returned {
            v_p: (inverse_z * v_slope).extend(v_depth),
            projected: [r0, r1],
            v_projected: [v_r0, v_r1],
            v_rows: [v_m0, v_m1, v_m2],
            opacity_logit,
        }
    }

    /// Viewing direction d = (μ − camera)/|μ − camera|; +z where the camera is at μ.
    #[inline]
    pub fn direction(&self, mean: Vec3) -> Vec3 {
        self.towards(mean).0
    }

    /// v_μ from v_d: (I − d dᵀ) v_d/|μ − camera|; 0 where the camera is at μ.
    #[inline]
    pub fn direction_vjp(&self, mean: Vec3, v_direction: Vec3) -> Vec3 {
        let (d, inverse_distance) = self.towards(mean);
        (v_direction - d * d.dot(v_direction)) * inverse_distance
    }

    /// v_μ from v_(1/z), z being [`Self::depth`] of a mean that is not nearer than the near plane.
    #[inline]
    pub fn inverse_depth_vjp(&self, mean: Vec3, v_inverse: f32) -> Vec3 {
        let inverse = 1.0 / self.depth(mean);
        self.rotation.row(2) * (-v_inverse * inverse * inverse)
    }

    #[inline(always)]
    fn towards(&self, mean: Vec3) -> (Vec3, f32) {
        let offset = mean - self.position;
        let norm2 = offset.length_squared();
        if (SAFE_SQUARES[0]..=SAFE_SQUARES[1]).contains(&norm2) {
            let inverse = 1.0 / norm2.sqrt();
            return (offset * inverse, inverse);
        }
        towards_extremes(offset)
    }

    /// W R with every column scaled: m₀, m₁, m₂.
    #[inline(always)]
    fn rows(&self, rotation: &Mat3, log_scale: Vec3) -> [Vec3; 3] {
        let scale = Vec3::new(log_scale.x.exp(), log_scale.y.exp(), log_scale.z.exp());
        rows_of(&(self.rotation * *rotation)).map(|row| row * scale)
    }

    #[inline(always)]
    fn intermediate(&self, p: Vec3, &[m0, m1, m2]: &[Vec3; 3]) -> Intermediate {
        let inverse_z = 1.0 / p.z;
        let slope = p.truncate() * inverse_z;
        let clamped = slope.max(self.slopes[0]).min(self.slopes[1]);
        let projected =
            [self.focal.x * inverse_z * (m0 - clamped.x * m2), self.focal.y * inverse_z * (m1 - clamped.y * m2)];
        Intermediate { projected, inverse_z, slope, clamped }
    }
}

/// [`Perspective::direction`] and 1/|offset| where |offset|² underflows or overflows.
#[cold]
fn towards_extremes(offset: Vec3) -> (Vec3, f32) {
    let largest = offset.abs().max_element();
    if largest == 0.0 {
        return (Vec3::Z, 0.0);
    }
    let scaled = offset / largest;
    let inverse = 1.0 / scaled.length();
    (scaled * inverse, (inverse / largest).min(f32::MAX))
}

#[inline(always)]
fn rows_of(matrix: &Mat3) -> [Vec3; 3] {
    [matrix.row(0), matrix.row(1), matrix.row(2)]
}

impl Quaternion {
    #[inline(always)]
    fn new(q: [f32; 4]) -> Self {
        let norm2 = |[w, x, y, z]: [f32; 4]| w * w + x * x + y * y + z * z;
        let plain = Self { scaled: q, norm2: norm2(q), scale: 1.0 };
        if plain.norm2 < f32::INFINITY {
            return plain;
        }
        let scaled = q.map(|c| c * QUATERNION_SHRINK);
        Self { scaled, norm2: norm2(scaled), scale: QUATERNION_SHRINK }
    }
}

/// v_ω of a turn ω about the camera's axes, dM = ω × M.
#[inline(always)]
fn turn_vjp([m0, m1, m2]: &[Vec3; 3], [v_m0, v_m1, v_m2]: &[Vec3; 3]) -> Vec3 {
    Vec3::new(m1.dot(*v_m2) - m2.dot(*v_m1), m2.dot(*v_m0) - m0.dot(*v_m2), m0.dot(*v_m1) - m1.dot(*v_m0))
}

#[inline(always)]
fn turned(quaternion: &Quaternion) -> Turned {
    let inverse_norm = 1.0 / quaternion.norm2.sqrt();
    let unit = quaternion.scaled.map(|c| c * inverse_norm);
    let inverse_norm = inverse_norm * quaternion.scale;
    let [w, x, y, z] = unit;
    let rotation = Mat3::from_cols(
        Vec3::new(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
        Vec3::new(2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
        Vec3::new(2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
    );
    Turned { rotation, unit, inverse_norm }
}

/// v_q of q with q/|q| = `unit`, from v_ω of a turn ω in the world's axes. As d(q/|q|) = ½ (0, ω)
/// q/|q|, it is 2 (0, v_ω) q/|q|².
#[inline(always)]
fn quaternion_vjp(unit: [f32; 4], inverse_norm: f32, v_turn: Vec3) -> [f32; 4] {
    let turn = v_turn * (2.0 * inverse_norm);
    let [w, x, y, z] = unit;
    let axis = Vec3::new(x, y, z);
    let imaginary = w * turn + turn.cross(axis);
    [-turn.dot(axis), imaginary.x, imaginary.y, imaginary.z]
}

#[cfg(test)]
mod tests;
