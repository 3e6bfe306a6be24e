//! One spatial Gaussian through a camera (paper eq. 3–5), and the way back of its gradients: the reference that every backend computes.
//!
//! With p = W μ + t and M = R(q/|q|) S, the Gaussian falls on the image as M′ = J W M (2×3), Σ′ = M′ M′ᵀ + δ I. J is taken at p, its slopes
//! x/z and y/z followed a little beyond the image and clamped there ([`JACOBIAN_MARGIN`]). det Σ is the sum of the squares of the three
//! minors of M′ (Cauchy–Binet), which does not cancel as Σxx Σyy − Σxy² does in needles.
//!
//! A Gaussian that is left out is counted under the first cause that applies: a parameter that is not finite; its mean nearer than the
//! near plane; a quaternion without direction; a mean or covariance that is not finite; det Σ′ too small; transparent; and then, which a
//! backend finds, touching no pixel, and a colour that is not finite.
//!
//! Legend: s = slopes (x/z, y/z), t = s clamped, m₀ m₁ m₂ = rows of W M, r₀ r₁ = rows of M′, n = r₀ × r₁ the minors, D = det Σ,
//! D′ = det Σ′, ρ = √(D/D′) the compensation of [`Antialias::Mip`], `v_x` = ∂L/∂x.

use glam::{Mat3, Vec2, Vec3};

use crate::{
    constants::{JACOBIAN_MARGIN, MIN_DETERMINANT_PX4, MIN_QUATERNION_NORM2},
    effects::{Antialias, Blend},
    scene::sigmoid,
    settings::RenderSettings,
    statistics::Cause,
    view::Camera,
};

/// A spatial Gaussian's parameters but for its colour; units as in [`SpatialScene`](crate::scene::SpatialScene). Also ∂L/∂each of them.
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

/// What the pixels need of a Gaussian, but for its colour. Units: px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projection {
    /// Where the mean falls.
    pub mean: Vec2,
    /// z of the mean, world units.
    pub depth: f32,
    /// Σ′: xx, xy, yy, px².
    pub covariance: [f32; 3],
    /// det Σ′, px⁴.
    pub determinant: f32,
    /// o: the sigmoid of the logit, under [`Antialias::Mip`] times ρ; 1 under [`Blend::Sum`].
    pub opacity: f32,
    /// cov(z, (u, v)) Σ′⁻¹, world units per px: where a pixel's centre is d away from the mean, the mean of z given that the ray goes
    /// through it is `depth` + `depth_slope` · d (compare RaDe-GS and StopThePop; exact for the affine approximation). It orders Gaussians under
    /// [`Order::PixelDepth`](crate::effects::Order::PixelDepth) and has no gradient.
    pub depth_slope: Vec2,
}

/// ∂L/∂(what a [`Projection`] holds), as the sums over the pixels yield it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ProjectionGradient {
    /// By the mean, px⁻¹.
    pub mean: Vec2,
    /// By Σ′xx; by Σ′xy and Σ′yx each; by Σ′yy. px⁻².
    pub covariance: [f32; 3],
    /// By ln o: Σ t with t = o·∂L/∂o, pixel by pixel.
    pub log_opacity: f32,
}

/// A camera with the effects that act on one Gaussian, made once per frame.
#[derive(Debug, Clone, Copy)]
pub struct Perspective {
    rotation: Mat3,
    translation: Vec3,
    position: Vec3,
    focal: Vec2,
    center: Vec2,
    near: f32,
    /// Between which the Jacobian's slopes are clamped.
    slopes: [Vec2; 2],
    dilation: f32,
    antialias: Antialias,
    blend: Blend,
    alpha_cut: f32,
}

/// What projection and its VJP both need.
struct Intermediate {
    /// W R as rows, each scaled: m₀, m₁, m₂.
    rows: [Vec3; 3],
    /// r₀, r₁.
    projected: [Vec3; 2],
    inverse_z: f32,
    slope: Vec2,
    clamped: Vec2,
    /// q/|q| and 1/|q|.
    unit: [f32; 4],
    inverse_norm: f32,
}

impl Perspective {
    /// A valid camera's, with valid settings.
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
        }
    }

    /// The least and the greatest slopes (x/z, y/z) that the Jacobian is taken at, for backends whose kernels clamp themselves.
    pub fn slopes(&self) -> [Vec2; 2] {
        self.slopes
    }

    /// Where a Gaussian falls on the image, and how large; or why it is left out.
    ///
    /// # Errors
    /// The first [`Cause`] that applies.
    #[inline]
    pub fn project(&self, g: &Ellipsoid) -> Result<Projection, Cause> {
        let [qw, qx, qy, qz] = g.rotation;
        let norm2 = qw * qw + qx * qx + qy * qy + qz * qz;
        // A sum is finite only if all its terms are.
        if !(g.mean.is_finite() && g.log_scale.is_finite() && norm2.is_finite()) || g.opacity_logit.is_nan() {
            return Err(Cause::NotFinite);
        }
        let p = self.rotation * g.mean + self.translation;
        if p.is_nan() {
            return Err(Cause::NotFinite);
        }
        if !(p.z >= self.near) {
            return Err(Cause::Near);
        }
        if !(norm2 >= MIN_QUATERNION_NORM2) {
            return Err(Cause::Degenerate);
        }
        let Intermediate { rows, projected: [r0, r1], slope, .. } = self.intermediate(g, p, norm2);
        let mean = self.focal * slope + self.center;
        let delta = self.dilation;
        let (xx, yy, xy) = (r0.length_squared(), r1.length_squared(), r0.dot(r1));
        let minors = r0.cross(r1);
        let undilated = minors.length_squared();
        let determinant = undilated + delta * (xx + yy) + delta * delta;
        let (xx, yy) = (xx + delta, yy + delta);
        if !(mean.is_finite() && (xx * yy).is_finite() && determinant.is_finite()) {
            return Err(Cause::NotFinite);
        }
        if !(determinant >= MIN_DETERMINANT_PX4) {
            return Err(Cause::Degenerate);
        }
        let opacity = match (self.blend, self.antialias) {
            (Blend::Sum, _) => 1.0,
            (Blend::Over, Antialias::Mip) => sigmoid(g.opacity_logit) * (undilated / determinant).sqrt(),
            (Blend::Over, _) => sigmoid(g.opacity_logit),
        };
        if !(opacity >= self.alpha_cut) {
            return Err(Cause::Transparent);
        }
        let (zu, zv) = (rows[2].dot(r0), rows[2].dot(r1));
        // z̃u Σyy − z̃v Σxy = m₂ · (r₁ × n), without the difference, which cancels in needles; and so for v.
        let undilated_slope = Vec2::new(rows[2].dot(r1.cross(minors)), rows[2].dot(minors.cross(r0)));
        let depth_slope = (undilated_slope + delta * Vec2::new(zu, zv)) / determinant;
        Ok(Projection { mean, depth: p.z, covariance: [xx, xy, yy], determinant, opacity, depth_slope })
    }

    /// ∂L/∂(mean, log-scale, rotation, opacity logit) of a Gaussian that [`Self::project`] accepts; not through its colour. The gradient by
    /// q is orthogonal to q.
    #[inline]
    pub fn project_vjp(&self, g: &Ellipsoid, v: &ProjectionGradient) -> Ellipsoid {
        let p = self.rotation * g.mean + self.translation;
        let norm2 = g.rotation.iter().map(|c| c * c).sum();
        let Intermediate { rows: [m0, m1, m2], projected: [r0, r1], inverse_z, slope, clamped, unit, inverse_norm } =
            self.intermediate(g, p, norm2);
        let [v_xx, v_xy, v_yy] = v.covariance;
        let mut v_r0 = 2.0 * (v_xx * r0 + v_xy * r1);
        let mut v_r1 = 2.0 * (v_xy * r0 + v_yy * r1);
        if self.antialias == Antialias::Mip && self.blend == Blend::Over {
            // ln ρ = ½ (ln D − ln D′), D = |n|², D′ = D + δ (|r₀|² + |r₁|²) + δ².
            let n = r0.cross(r1);
            let (det, trace, delta) = (n.length_squared(), r0.length_squared() + r1.length_squared(), self.dilation);
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
        let v_p = (inverse_z * v_slope).extend(v_depth);
        // A turn ω of the camera's axes, then of the world's: dM = ω × M.
        let turn = Vec3::new(m1.dot(v_m2) - m2.dot(v_m1), m2.dot(v_m0) - m0.dot(v_m2), m0.dot(v_m1) - m1.dot(v_m0));
        let to_world = self.rotation.transpose();
        let turn = to_world * turn * (2.0 * inverse_norm);
        // d(q/|q|) = ½ (0, ω) q/|q|, so that v_q = 2 (0, v_ω) q/|q|².
        let [w, x, y, z] = unit;
        let axis = Vec3::new(x, y, z);
        let imaginary = w * turn + turn.cross(axis);
        let opacity_logit = match self.blend {
            Blend::Sum => 0.0,
            Blend::Over => v.log_opacity * sigmoid(-g.opacity_logit),
        };
        Ellipsoid {
            mean: to_world * v_p,
            log_scale: v_r0 * r0 + v_r1 * r1,
            rotation: [-turn.dot(axis), imaginary.x, imaginary.y, imaginary.z],
            opacity_logit,
        }
    }

    /// d = (μ − camera)/|…|, along which the colour is seen; +z where the camera is at μ.
    #[inline]
    pub fn direction(&self, mean: Vec3) -> Vec3 {
        self.towards(mean).0
    }

    /// From v_d to v_μ: (I − d dᵀ) v_d/|μ − camera|; 0 where the camera is at μ.
    #[inline]
    pub fn direction_vjp(&self, mean: Vec3, v_direction: Vec3) -> Vec3 {
        let (d, inverse_distance) = self.towards(mean);
        (v_direction - d * d.dot(v_direction)) * inverse_distance
    }

    #[inline(always)]
    fn towards(&self, mean: Vec3) -> (Vec3, f32) {
        let offset = mean - self.position;
        let inverse = offset.length_recip();
        if inverse.is_finite() { (offset * inverse, inverse) } else { (Vec3::Z, 0.0) }
    }

    #[inline(always)]
    fn intermediate(&self, g: &Ellipsoid, p: Vec3, norm2: f32) -> Intermediate {
        let inverse_norm = 1.0 / norm2.sqrt();
        let unit = g.rotation.map(|c| c * inverse_norm);
        let [w, x, y, z] = unit;
        let rotation = Mat3::from_cols(
            Vec3::new(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
            Vec3::new(2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
            Vec3::new(2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
        );
        let scale = Vec3::new(g.log_scale.x.exp(), g.log_scale.y.exp(), g.log_scale.z.exp());
        let turned = self.rotation * rotation;
        let rows = [turned.row(0) * scale, turned.row(1) * scale, turned.row(2) * scale];
        let inverse_z = 1.0 / p.z;
        let slope = p.truncate() * inverse_z;
        let clamped = slope.max(self.slopes[0]).min(self.slopes[1]);
        let [m0, m1, m2] = rows;
        let projected =
            [self.focal.x * inverse_z * (m0 - clamped.x * m2), self.focal.y * inverse_z * (m1 - clamped.y * m2)];
        Intermediate { rows, projected, inverse_z, slope, clamped, unit, inverse_norm }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::SpatialGaussian;

    fn camera() -> Camera {
        let axis = Vec3::new(0.3, -0.8, 0.5).normalize();
        Camera {
            rotation: Mat3::from_axis_angle(axis, 0.4),
            translation: Vec3::new(0.2, -0.1, 0.5),
            focal: Vec2::new(90.0, 100.0),
            center: Vec2::new(30.0, 27.0),
            ..Camera::looking_forward(64, 48, 1.0)
        }
    }

    fn ellipsoid(mean: Vec3) -> Ellipsoid {
        Ellipsoid { mean, log_scale: Vec3::new(-1.2, -2.0, -0.7), rotation: [0.9, -0.4, 0.6, 0.3], opacity_logit: 0.4 }
    }

    fn settings(antialias: Antialias) -> RenderSettings {
        let mut settings = RenderSettings::blended(Blend::Over);
        settings.effects.antialias = antialias;
        settings
    }

    /// In view, and beyond both clamps.
    const MEANS: [Vec3; 3] = [Vec3::new(0.4, 0.2, 2.5), Vec3::new(5.0, 0.4, 2.0), Vec3::new(-3.0, -4.0, 2.0)];

    #[test]
    fn the_projection_is_that_of_the_covariance() {
        let perspective = Perspective::new(&camera(), &settings(Antialias::Dilate));
        let g = ellipsoid(MEANS[0]);
        let found = perspective.project(&g).unwrap();
        let (mean, depth) = camera().project(g.mean).unwrap();
        assert!((found.mean - mean).length() < 1e-4 && (found.depth - depth).abs() < 1e-6);
        let gaussian = SpatialGaussian {
            mean: g.mean,
            log_scale: g.log_scale,
            rotation: g.rotation,
            opacity_logit: 0.0,
            sh: Vec::new(),
        };
        let p = camera().to_camera(g.mean);
        let sigma = camera().rotation * gaussian.covariance().unwrap() * camera().rotation.transpose();
        let gradients = [
            Vec3::new(90.0 / p.z, 0.0, -90.0 * p.x / (p.z * p.z)),
            Vec3::new(0.0, 100.0 / p.z, -100.0 * p.y / (p.z * p.z)),
        ];
        let across = |a: usize, b: usize| gradients[a].dot(sigma * gradients[b]);
        let expected = [across(0, 0) + 0.3, across(0, 1), across(1, 1) + 0.3];
        for (found, expected) in found.covariance.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-3, "{found} {expected}");
        }
        let [xx, xy, yy] = found.covariance;
        assert!((found.determinant / (xx * yy - xy * xy) - 1.0).abs() < 1e-4);
        let by_z = Vec2::new((sigma * gradients[0]).z, (sigma * gradients[1]).z);
        let back = Vec2::new(
            xx * found.depth_slope.x + xy * found.depth_slope.y,
            xy * found.depth_slope.x + yy * found.depth_slope.y,
        );
        assert!((back - by_z).length() < 1e-4, "{back} {by_z}");
    }

    #[test]
    fn gradients_are_central_differences() {
        let v = ProjectionGradient { mean: Vec2::new(0.7, -0.4), covariance: [0.3, -0.2, 0.5], log_opacity: 0.9 };
        for (antialias, mean) in
            [Antialias::None, Antialias::Dilate, Antialias::Mip].into_iter().flat_map(|a| MEANS.map(|m| (a, m)))
        {
            let perspective = Perspective::new(&camera(), &settings(antialias));
            let g = ellipsoid(mean);
            let scale = perspective.project(&g).unwrap().covariance[0].max(1.0);
            let loss = |g: &Ellipsoid| -> f64 {
                let p = perspective.project(g).unwrap();
                let [xx, xy, yy] = p.covariance.map(f64::from);
                let [a, b, c] = v.covariance.map(|c| f64::from(c / scale));
                f64::from(v.mean.dot(p.mean))
                    + a * xx
                    + 2.0 * b * xy
                    + c * yy
                    + f64::from(v.log_opacity) * f64::from(p.opacity).ln()
            };
            let scaled = ProjectionGradient { covariance: v.covariance.map(|c| c / scale), ..v };
            let found = perspective.project_vjp(&g, &scaled);
            let dot: f32 = found.rotation.iter().zip(g.rotation).map(|(a, b)| a * b).sum();
            assert!(dot.abs() < 1e-4, "not orthogonal to q: {dot}");
            let flat = |g: &Ellipsoid| -> [f32; 11] {
                let [w, x, y, z] = g.rotation;
                let (m, s) = (g.mean, g.log_scale);
                [m.x, m.y, m.z, s.x, s.y, s.z, w, x, y, z, g.opacity_logit]
            };
            let built = |[a, b, c, d, e, f, w, x, y, z, o]: [f32; 11]| Ellipsoid {
                mean: Vec3::new(a, b, c),
                log_scale: Vec3::new(d, e, f),
                rotation: [w, x, y, z],
                opacity_logit: o,
            };
            let largest = flat(&found).iter().fold(0.0f32, |m, v| m.max(v.abs()));
            for k in 0..11 {
                let (mut up, mut down) = (flat(&g), flat(&g));
                up[k] += 4e-3;
                down[k] -= 4e-3;
                let numeric = (loss(&built(up)) - loss(&built(down))) / f64::from(up[k] - down[k]);
                let error = (f64::from(flat(&found)[k]) - numeric).abs();
                assert!(error < 2e-3 * f64::from(largest), "{antialias:?} {mean} {k}: {} {numeric}", flat(&found)[k]);
            }
        }
    }

    #[test]
    fn directions_and_their_gradients() {
        let perspective = Perspective::new(&camera(), &settings(Antialias::None));
        let (mean, v) = (MEANS[0], Vec3::new(0.3, -0.5, 0.8));
        let found = perspective.direction_vjp(mean, v);
        for axis in 0..3 {
            let h = Vec3::AXES[axis] * 1e-2;
            let numeric = (perspective.direction(mean + h) - perspective.direction(mean - h)).dot(v) / 2e-2;
            assert!((found[axis] - numeric).abs() < 1e-4);
        }
        let at_camera = camera().position();
        assert_eq!(perspective.direction(at_camera), Vec3::Z);
        assert_eq!(perspective.direction_vjp(at_camera, v), Vec3::ZERO);
    }

    #[test]
    fn what_is_left_out_has_a_cause() {
        let perspective = Perspective::new(&camera(), &settings(Antialias::None));
        let good = ellipsoid(MEANS[0]);
        let cause = |g: Ellipsoid| perspective.project(&g).unwrap_err();
        assert_eq!(cause(Ellipsoid { mean: Vec3::new(f32::NAN, 0.0, -9.0), ..good }), Cause::NotFinite);
        assert_eq!(cause(Ellipsoid { mean: Vec3::new(0.0, 0.0, -9.0), ..good }), Cause::Near);
        assert_eq!(cause(Ellipsoid { mean: camera().position(), ..good }), Cause::Near);
        assert_eq!(cause(Ellipsoid { rotation: [0.0; 4], ..good }), Cause::Degenerate);
        assert_eq!(cause(Ellipsoid { rotation: [f32::INFINITY; 4], ..good }), Cause::NotFinite);
        assert_eq!(cause(Ellipsoid { log_scale: Vec3::splat(80.0), ..good }), Cause::NotFinite);
        assert_eq!(cause(Ellipsoid { log_scale: Vec3::splat(-80.0), ..good }), Cause::Degenerate);
        assert_eq!(cause(Ellipsoid { opacity_logit: f32::NEG_INFINITY, ..good }), Cause::Transparent);
        assert_eq!(cause(Ellipsoid { opacity_logit: f32::NAN, ..good }), Cause::NotFinite);
        assert_eq!(perspective.project(&Ellipsoid { opacity_logit: f32::INFINITY, ..good }).unwrap().opacity, 1.0);
        let mip = Perspective::new(&camera(), &settings(Antialias::Mip));
        let flat = Ellipsoid { log_scale: Vec3::new(-1.0, -200.0, -200.0), ..good };
        assert_eq!(mip.project(&flat).unwrap_err(), Cause::Transparent);
        assert!(
            mip.project_vjp(&flat, &ProjectionGradient { log_opacity: 1.0, ..Default::default() }).mean.is_finite()
        );
    }
}
