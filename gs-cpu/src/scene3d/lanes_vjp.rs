//! The gradients of several Gaussians at a time, a lane each: `Perspective::project_vjp` and
//! `sh::color_vjp` of gs-core, whose legends hold here.

use fearless_simd::{Simd, prelude::*};
use gs_core::{
    constants::{SH_C1, SH_C2, SH_C3},
    math::sh::{MOST_COEFFICIENTS, coefficients},
};

use super::{
    lanes_project::{Columns, Geometry, added, basis, cross, direction, dot, load_all, scaled, store_all},
    project::Eye,
    splats::{LOG_SCALE, MEAN, OPACITY, ROTATION, SH},
};
use crate::lanes::{Floats, LANES, exp_less, fma, load, splat, store};

/// Gradients by the camera: a row for each number of `CameraGradient::to_array`, a lane for each
/// Gaussian.
pub(super) type CameraLanes = [[f32; LANES]; 10];

/// What Gaussians received from the pixels, and what their gradients leave behind besides a row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lanes {
    /// 1/Σxx, slope and c of the splat.
    pub(super) ridge: [[f32; LANES]; 3],
    pub(super) color: [[f32; LANES]; 3],
    pub(super) first: [[f32; LANES]; 2],
    pub(super) second: [[f32; LANES]; 3],
    pub(super) zeroth: [[f32; LANES]; 1],
    /// ∂L/∂ the mean on the image; written here.
    pub(super) v_mean: [[f32; LANES]; 2],
}

impl Lanes {
    pub(super) const ZERO: Self = Self {
        ridge: [[0.0; LANES]; 3],
        color: [[0.0; LANES]; 3],
        first: [[0.0; LANES]; 2],
        second: [[0.0; LANES]; 3],
        zeroth: [[0.0; LANES]; 1],
        v_mean: [[0.0; LANES]; 2],
    };
}

/// Writes the gradients by all numbers up to the evaluated SH, times `scale`; with `CAMERA` also
/// those by the camera, `Perspective::camera_vjp`.
///
/// Returns the lanes, as bits, whose numbers are too extreme for it, and whose gradients are
/// unspecified.
#[inline(always)]
pub(super) fn gradients<S: Simd, const CAMERA: bool>(
    simd: S,
    (eye, scale): (&Eye, f32),
    given: &Columns,
    lanes: &mut Lanes,
    out: &mut Columns,
    camera: &mut CameraLanes,
) -> u64 {
    let mut extreme = 0;
    for lane in (0..LANES).step_by(S::f32s::LEN) {
        extreme |= part::<S, S::f32s, CAMERA>(simd, (eye, scale), given, lanes, out, camera, lane) << lane;
    }
    extreme
}

/// [`gradients`] of the lanes of one vector, as bits from 0 on.
#[inline(always)]
fn part<S: Simd, V: Floats<S>, const CAMERA: bool>(
    simd: S,
    (eye, scale): (&Eye, f32),
    given: &Columns,
    lanes: &mut Lanes,
    out: &mut Columns,
    camera: &mut CameraLanes,
    lane: usize,
) -> u64 {
    let zero: V = splat(simd, 0.0);
    let one: V = splat(simd, 1.0);
    let (geometry, mut usual) = Geometry::<V>::new(simd, eye, given, lane);
    let Geometry { turn, p, w, axis, inverse_norm, m: [m0, m1, m2], inverse_z, r: [r0, r1], .. } = geometry;
    let ([sx, sy], [cx, cy], [fx, fy]) = (geometry.slope, geometry.clamped, geometry.scale);

    // Upstream, by the ridge's coordinates.
    let [inverse_xx, slope, c]: [V; 3] = load_all(simd, &lanes.ridge, 0, lane);
    let [dx, u]: [V; 2] = load_all(simd, &lanes.first, 0, lane);
    let [xx, xu, uu]: [V; 3] = load_all(simd, &lanes.second, 0, lane);
    let across = zero - slope * c;
    let (v_u, v_v) = (fma(inverse_xx, dx, across * u) * scale, c * u * scale);
    store(v_u, &mut lanes.v_mean[0], lane);
    store(v_v, &mut lanes.v_mean[1], lane);
    let half = 0.5 * scale;
    let by_x = fma(inverse_xx, xx, across * xu);
    let by_u = fma(inverse_xx, xu, across * uu);
    let v_xx = fma(inverse_xx, by_x, across * by_u) * half;
    let v_xy = c * by_u * half;
    let v_yy = c * c * uu * half;
    let v_log_opacity = load::<S, V>(simd, &lanes.zeroth[0], lane) * scale;

    // Back through Σ′ = M′ M′ᵀ + δ I and the Jacobian.
    let mut v_r0 = added(scaled(r0, v_xx + v_xx), r1, v_xy + v_xy);
    let mut v_r1 = added(scaled(r1, v_yy + v_yy), r0, v_xy + v_xy);
    if let Some(delta) = eye.compensated_dilation {
        let n = cross(r0, r1);
        let (det, trace) = (dot(n, n), dot(r0, r0) + dot(r1, r1));
        let grown = trace * delta + delta * delta;
        let drawn = det.simd_gt(zero);
        let by_minors = drawn.select(v_log_opacity * grown / (det * (det + grown)), zero);
        let by_trace = drawn.select(v_log_opacity * delta / (det + grown), zero);
        v_r0 = added(added(v_r0, cross(r1, n), by_minors), r0, zero - by_trace);
        v_r1 = added(added(v_r1, cross(n, r0), by_minors), r1, zero - by_trace);
    }
    let (v_m0, v_m1) = (scaled(v_r0, fx), scaled(v_r1, fy));
    let v_m2 = added(scaled(v_m0, zero - cx), v_m1, zero - cy);
    let (of_x, of_y) = (dot(v_m0, m2), dot(v_m1, m2));
    let v_sx = v_u * eye.focal[0] - sx.simd_eq(cx).select(of_x, zero);
    let v_sy = v_v * eye.focal[1] - sy.simd_eq(cy).select(of_y, zero);
    let (by_r0, by_r1) = (dot(v_r0, r0), dot(v_r1, r1));
    let along = fma(v_sx, sx, v_sy * sy) + by_r0 + by_r1;
    let v_p = [inverse_z * v_sx, inverse_z * v_sy, zero - inverse_z * along];
    let mut v_mean = [zero; 3];
    for (row, v) in turn.into_iter().zip(v_p) {
        v_mean = added(v_mean, row, v);
    }
    for k in 0..3 {
        store(fma(v_r0[k], r0[k], v_r1[k] * r1[k]), &mut out[LOG_SCALE.start + k], lane);
    }
    let v_turn = [dot(m1, v_m2) - dot(m2, v_m1), dot(m2, v_m0) - dot(m0, v_m2), dot(m0, v_m1) - dot(m1, v_m0)];
    if CAMERA {
        let (by_x, by_y) = (sx.simd_eq(cx).select(zero, of_x), sy.simd_eq(cy).select(zero, of_y));
        let [inverse_fx, inverse_fy] = eye.focal.map(|f| 1.0 / f);
        let focal = [fma(v_u, sx, fma(by_x, cx, by_r0) * inverse_fx), fma(v_v, sy, fma(by_y, cy, by_r1) * inverse_fy)];
        store_all(v_p, &mut camera[0..3], lane);
        store_all(added(cross(p, v_p), v_turn, one), &mut camera[3..6], lane);
        store_all(focal, &mut camera[6..8], lane);
        store_all(
            [fma(by_x, splat(simd, inverse_fx), v_u), fma(by_y, splat(simd, inverse_fy), v_v)],
            &mut camera[8..10],
            lane,
        );
    }
    let mut v_world = [zero; 3];
    for (row, v) in turn.into_iter().zip(v_turn) {
        v_world = added(v_world, row, v);
    }
    let v_world = scaled(v_world, inverse_norm + inverse_norm);
    let imaginary = added(cross(v_world, axis), v_world, w);
    store(zero - dot(v_world, axis), &mut out[ROTATION.start], lane);
    for k in 0..3 {
        store(imaginary[k], &mut out[ROTATION.start + 1 + k], lane);
    }
    let logit: V = load(simd, &given[OPACITY], lane);
    let v_logit = if eye.is_over { v_log_opacity / (exp_less(simd, logit, 0.0) + 1.0) } else { zero };
    store(v_logit, &mut out[OPACITY], lane);

    let v_color: [V; 3] = load_all(simd, &lanes.color, 0, lane);
    let v_color = scaled(v_color, splat(simd, scale));
    if eye.degree == 0 {
        color_gradients(simd, 0, [zero; 3], v_color, given, out, lane);
    } else {
        let (d, inverse, near) = direction(simd, eye, load_all(simd, given, MEAN.start, lane));
        usual &= near;
        let v_d = color_gradients(simd, eye.degree, d, v_color, given, out, lane);
        let tangential = added(v_d, d, zero - dot(d, v_d));
        v_mean = added(v_mean, tangential, inverse);
        if CAMERA {
            let of_camera = [dot(turn[0], tangential), dot(turn[1], tangential), dot(turn[2], tangential)];
            store_all(added(v_p, of_camera, inverse), &mut camera[0..3], lane);
        }
    }
    for k in 0..3 {
        store(v_mean[k], &mut out[MEAN.start + k], lane);
    }
    (!usual).to_bitmask()
}

/// Writes the gradients by the SH coefficients and returns that by the direction.
#[inline(always)]
fn color_gradients<S: Simd, V: Floats<S>>(
    simd: S,
    degree: u8,
    d: [V; 3],
    v_color: [V; 3],
    given: &Columns,
    out: &mut Columns,
    lane: usize,
) -> [V; 3] {
    let count = coefficients(degree);
    let y_k = basis(simd, degree, d);
    let mut v = [splat(simd, 0.0); 3];
    for channel in 0..3 {
        let mut color: V = splat(simd, 0.5);
        for k in 0..count {
            color = fma(load(simd, &given[SH + 3 * k + channel], lane), y_k[k], color);
        }
        v[channel] = color.simd_gt(splat::<S, V>(simd, 0.0)).select(v_color[channel], v[channel]);
    }
    let mut a = [splat(simd, 0.0); MOST_COEFFICIENTS];
    for k in 0..count {
        let mut sum: V = splat(simd, 0.0);
        for channel in 0..3 {
            sum = fma(load(simd, &given[SH + 3 * k + channel], lane), v[channel], sum);
            store(v[channel] * y_k[k], &mut out[SH + 3 * k + channel], lane);
        }
        a[k] = sum;
    }
    weighted_gradients(simd, degree, d, &a)
}

/// Σ a_k ∇Y_k(d), as if the components of d were free.
#[inline(always)]
fn weighted_gradients<S: Simd, V: Floats<S>>(
    simd: S,
    degree: u8,
    [x, y, z]: [V; 3],
    a: &[V; MOST_COEFFICIENTS],
) -> [V; 3] {
    if degree == 0 {
        return [splat(simd, 0.0); 3];
    }
    let (mut by_x, mut by_y, mut by_z) = (a[3] * -SH_C1, a[1] * -SH_C1, a[2] * SH_C1);
    if degree == 1 {
        return [by_x, by_y, by_z];
    }
    let (xy, yz, zz) = (a[4] * SH_C2[0], a[5] * SH_C2[1], a[6] * (2.0 * SH_C2[2]));
    let (xz, xx) = (a[7] * SH_C2[3], a[8] * (2.0 * SH_C2[4]));
    by_x += xy * y + xz * z + (xx - zz) * x;
    by_y += xy * x + yz * z - (xx + zz) * y;
    by_z += yz * y + xz * x + zz * z * 2.0;
    if degree == 2 {
        return [by_x, by_y, by_z];
    }
    let (b0, b1, b2, b3) = (a[9] * SH_C3[0], a[10] * SH_C3[1], a[11] * SH_C3[2], a[12] * SH_C3[3]);
    let (b4, b5, b6) = (a[13] * SH_C3[4], a[14] * SH_C3[5], a[15] * SH_C3[6]);
    let (x2, y2, z2) = (x * x, y * y, z * z);
    let ring = z2 * 4.0 - x2 - y2;
    let (flat, b03, b63) = (x2 - y2, b0 * 3.0, b6 * 3.0);
    by_x += b03 * x * y * 2.0 + b1 * y * z - b2 * x * y * 2.0 - b3 * x * z * 6.0
        + b4 * (ring - x2 * 2.0)
        + b5 * x * z * 2.0
        + b63 * flat;
    by_y += b03 * flat + b1 * x * z + b2 * (ring - y2 * 2.0)
        - b3 * y * z * 6.0
        - b4 * x * y * 2.0
        - b5 * y * z * 2.0
        - b63 * x * y * 2.0;
    by_z += b1 * x * y + b2 * y * z * 8.0 + b3 * (z2 * 2.0 - x2 - y2) * 3.0 + b4 * x * z * 8.0 + b5 * flat;
    [by_x, by_y, by_z]
}
