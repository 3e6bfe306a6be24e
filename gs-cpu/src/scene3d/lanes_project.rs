//! The projection of several Gaussians at a time, a lane each: `Perspective::project` and
//! `sh::color` of gs-core, whose symbols are used here, and `Splat::new`.

use fearless_simd::{Simd, prelude::*};
use gs_core::{
    CullCause, Output,
    constants::{MIN_DETERMINANT_PX4, MIN_QUATERNION_NORM2, SAFE_SQUARES, SH_C0, SH_C1, SH_C2, SH_C3},
    math::sh::{MOST_COEFFICIENTS, coefficients},
};

use super::{
    project::Eye,
    splats::{LOG_SCALE, MEAN, MOST_NUMBERS, OPACITY, ROTATION, SH, pitch_of},
};
use crate::{
    bin::SLACK,
    lanes::{Floats, LANES, exp, exp_less, fma, ln, load, splat, splat3, store, transpose},
    layout::Grid,
    splat::{PixelDepth, RECURRENCE_ROWS, SAFE_EXPONENT, Splat, WIDE},
};

/// Rows of up to [`LANES`] Gaussians, transposed: a row for each number, a lane for each Gaussian.
pub(super) type Columns = [[f32; LANES]; MOST_NUMBERS];

/// Largest magnitude of a logarithm or logit whose exponential is computed in lanes.
const SAFE_LOGARITHM: f32 = 80.0;

/// The first of the numbers of a [`Splat`] that are its colour.
const COLOR: usize = 7;

/// What projection and its gradients share.
pub(super) struct Geometry<V> {
    /// Rows of the rotation from the world's to the camera's axes.
    pub(super) turn: [[V; 3]; 3],
    pub(super) p: [V; 3],
    /// q/|q| and 1/|q|.
    pub(super) w: V,
    pub(super) axis: [V; 3],
    pub(super) norm2: V,
    pub(super) inverse_norm: V,
    /// m₀, m₁, m₂.
    pub(super) m: [[V; 3]; 3],
    pub(super) inverse_z: V,
    /// s and t.
    pub(super) slope: [V; 2],
    pub(super) clamped: [V; 2],
    /// fx/z and fy/z.
    pub(super) scale: [V; 2],
    /// r₀, r₁.
    pub(super) r: [[V; 3]; 2],
}

impl<V> Geometry<V> {
    /// Also returns the lanes whose logarithms and quaternion are not too extreme for it.
    #[inline(always)]
    pub(super) fn new<S: Simd>(simd: S, eye: &Eye, given: &[[f32; LANES]], lane: usize) -> (Self, V::Mask)
    where
        V: Floats<S>,
    {
        let one: V = splat(simd, 1.0);
        let zero: V = splat(simd, 0.0);
        let mean: [V; 3] = load_all(simd, given, MEAN.start, lane);
        let log_scale: [V; 3] = load_all(simd, given, LOG_SCALE.start, lane);
        let [w, x, y, z]: [V; 4] = load_all(simd, given, ROTATION.start, lane);
        let logit: V = load(simd, &given[OPACITY], lane);
        let norm2 = fma(w, w, fma(x, x, fma(y, y, z * z)));
        let largest = log_scale[0].abs().max(log_scale[1].abs()).max(log_scale[2].abs().max(logit.abs()));
        let mut usual = largest.simd_le(splat::<S, V>(simd, SAFE_LOGARITHM));
        // A maximum may lose a NaN, which a sum does not.
        let sum = log_scale[0] + log_scale[1] + (log_scale[2] + logit);
        usual &= sum.abs().simd_lt(splat::<S, V>(simd, f32::INFINITY));
        usual &= norm2.simd_lt(splat::<S, V>(simd, f32::INFINITY));

        let turn: [[V; 3]; 3] =
            [splat3(simd, eye.rotation[0]), splat3(simd, eye.rotation[1]), splat3(simd, eye.rotation[2])];
        let [tx, ty, tz]: [V; 3] = splat3(simd, eye.translation);
        let p = [dot(turn[0], mean) + tx, dot(turn[1], mean) + ty, dot(turn[2], mean) + tz];
        let inverse_norm = one / norm2.sqrt();
        let (w, axis) = (w * inverse_norm, scaled([x, y, z], inverse_norm));
        let [x, y, z] = axis;
        let (x2, y2, z2) = (x + x, y + y, z + z);
        let r = [
            [one - fma(y, y2, z * z2), x * y2 - w * z2, fma(x, z2, w * y2)],
            [fma(x, y2, w * z2), one - fma(x, x2, z * z2), y * z2 - w * x2],
            [x * z2 - w * y2, fma(y, z2, w * x2), one - fma(x, x2, y * y2)],
        ];
        let scales =
            [exp_less(simd, log_scale[0], 0.0), exp_less(simd, log_scale[1], 0.0), exp_less(simd, log_scale[2], 0.0)];
        let m0 = times(combined(turn[0], &r), scales);
        let m1 = times(combined(turn[1], &r), scales);
        let m2 = times(combined(turn[2], &r), scales);
        let inverse_z = one / p[2];
        let (sx, sy) = (p[0] * inverse_z, p[1] * inverse_z);
        let [least, most] = eye.perspective.slopes();
        let cx = sx.max(splat::<S, V>(simd, least.x)).min(splat::<S, V>(simd, most.x));
        let cy = sy.max(splat::<S, V>(simd, least.y)).min(splat::<S, V>(simd, most.y));
        let (fx, fy) = (inverse_z * eye.focal[0], inverse_z * eye.focal[1]);
        let r = [scaled(added(m0, m2, zero - cx), fx), scaled(added(m1, m2, zero - cy), fy)];
        let (m, slope, clamped, scale) = ([m0, m1, m2], [sx, sy], [cx, cy], [fx, fy]);
        (Self { turn, p, w, axis, norm2, inverse_norm, m, inverse_z, slope, clamped, scale, r }, usual)
    }
}

/// The direction from which Gaussians are seen, 1/distance, and the lanes whose distance is not too
/// extreme for it.
#[inline(always)]
pub(super) fn direction<S: Simd, V: Floats<S>>(simd: S, eye: &Eye, mean: [V; 3]) -> ([V; 3], V, V::Mask) {
    let [px, py, pz]: [V; 3] = splat3(simd, eye.position);
    let offset = [mean[0] - px, mean[1] - py, mean[2] - pz];
    let distance2 = dot(offset, offset);
    let mut usual = distance2.simd_ge(splat::<S, V>(simd, SAFE_SQUARES[0]));
    usual &= distance2.simd_le(splat::<S, V>(simd, SAFE_SQUARES[1]));
    let inverse = splat::<S, V>(simd, 1.0) / distance2.sqrt();
    (scaled(offset, inverse), inverse, usual)
}

/// What Gaussians are projected to, besides the eye.
#[derive(Clone, Copy)]
pub(super) struct Limits<'a> {
    pub(super) grid: &'a Grid,
    pub(super) alpha_cut: f32,
}

/// Projected Gaussians, a row each, and which of them are not drawn, as bits.
pub(super) struct Projected {
    /// The numbers of [`Splat`].
    splats: [[f32; LANES]; LANES],
    /// Columns of the numbers of [`PixelDepth`].
    depths: [[f32; LANES]; 3],
    near: u64,
    transparent: u64,
    outside: u64,
    /// Those whose numbers are too extreme for lanes.
    extreme: u64,
}

impl Projected {
    /// The result for a lane; `None` where its numbers are too extreme.
    pub(super) fn of(&self, lane: usize) -> Option<Result<(Splat, PixelDepth), CullCause>> {
        let is = |bits: u64| bits >> lane & 1 == 1;
        if is(self.extreme) {
            return None;
        }
        for (bits, cause) in [
            (self.near, CullCause::Near),
            (self.transparent, CullCause::Transparent),
            (self.outside, CullCause::Outside),
        ] {
            if is(bits) {
                return Some(Err(cause));
            }
        }
        let [u, v, inverse_xx, slope, c, ratio, fall, r, g, b, opacity, cut, reach, half_x, lowest_dx, restart] =
            self.splats[lane];
        let splat = Splat {
            mean: [u, v],
            inverse_xx,
            slope,
            c,
            ratio,
            fall,
            color: [r, g, b],
            opacity,
            cut,
            reach,
            half_x,
            lowest_dx,
            restart_rows: restart as u32,
        };
        let [depth, du, dv] = self.depths.map(|numbers| numbers[lane]);
        Some(Ok((splat, PixelDepth { depth, slope: [du, dv] })))
    }
}

/// Projects up to [`LANES`] Gaussians, whose rows of parameters follow each other.
#[inline(always)]
pub(super) fn project<S: Simd>(simd: S, eye: &Eye, limits: Limits<'_>, rows: &[f32], pitch: usize) -> Projected {
    let mut out = Projected {
        splats: [[0.0; LANES]; LANES],
        depths: [[0.0; LANES]; 3],
        near: 0,
        transparent: 0,
        outside: 0,
        extreme: u64::MAX,
    };
    if eye.output != Output::Color {
        return out;
    }
    out.extreme = 0;
    let count = rows.len() / pitch;
    let mut given: Columns = [[0.0; LANES]; MOST_NUMBERS];
    columns(simd, rows, pitch, u64::MAX >> (u64::BITS as usize - count), &mut given, 0);
    for lane in (0..LANES).step_by(S::f32s::LEN) {
        place::<S, S::f32s>(simd, eye, limits, &given, &mut out, lane);
    }
    let drawn = (u64::MAX >> (u64::BITS as usize - count)) & !(out.near | out.transparent | out.outside | out.extreme);
    if drawn != 0 {
        for at in (LANES..pitch_of(eye.degree)).step_by(LANES) {
            columns(simd, rows, pitch, drawn, &mut given, at);
        }
        for lane in (0..LANES).step_by(S::f32s::LEN) {
            out.extreme |= paint::<S, S::f32s>(simd, eye, &given, &mut out.splats, lane) << lane & drawn;
        }
        let mut whole = [splat(simd, 0.0); LANES];
        for (vector, numbers) in whole.iter_mut().zip(&out.splats) {
            *vector = load(simd, numbers, 0);
        }
        transpose::<S>(&mut whole);
        for (vector, numbers) in whole.into_iter().zip(&mut out.splats) {
            store(vector, numbers, 0);
        }
    }
    out
}

/// Writes 16 numbers of the rows of these lanes, from `at` on, into columns.
#[inline(always)]
fn columns<S: Simd>(simd: S, rows: &[f32], pitch: usize, lanes: u64, out: &mut Columns, at: usize) {
    let mut vectors = [splat(simd, 0.0); LANES];
    for (lane, (vector, row)) in vectors.iter_mut().zip(rows.chunks_exact(pitch)).enumerate() {
        if lanes >> lane & 1 == 1 {
            *vector = load(simd, row, at);
        }
    }
    transpose::<S>(&mut vectors);
    for (vector, column) in vectors.into_iter().zip(&mut out[at..at + LANES]) {
        store(vector, column, 0);
    }
}

/// Projects the lanes of one vector, without their colour.
#[inline(always)]
fn place<S: Simd, V: Floats<S>>(
    simd: S,
    eye: &Eye,
    limits: Limits<'_>,
    given: &Columns,
    out: &mut Projected,
    lane: usize,
) {
    let (one, zero, infinity): (V, V, V) = (splat(simd, 1.0), splat(simd, 0.0), splat(simd, f32::INFINITY));
    let (Geometry { p, norm2, m: [_, _, m2], slope, r: [r0, r1], .. }, mut usual) =
        Geometry::<V>::new(simd, eye, given, lane);
    usual &= norm2.simd_ge(splat::<S, V>(simd, MIN_QUATERNION_NORM2));
    usual &= (p[0].abs() + p[1].abs() + p[2].abs()).simd_lt(infinity);
    let in_front = p[2].simd_ge(splat::<S, V>(simd, eye.near));
    let (u, v) = (
        fma(slope[0], splat(simd, eye.focal[0]), splat(simd, eye.center[0])),
        fma(slope[1], splat(simd, eye.focal[1]), splat(simd, eye.center[1])),
    );
    let delta: V = splat(simd, eye.dilation);
    let (xx, yy, xy) = (dot(r0, r0), dot(r1, r1), dot(r0, r1));
    let n = cross(r0, r1);
    let undilated = dot(n, n);
    let determinant = undilated + delta * (xx + yy) + delta * delta;
    let (xx, yy) = (xx + delta, yy + delta);
    let mut placed = (u.abs() + v.abs() + xx * yy).simd_lt(infinity);
    placed &= determinant.simd_lt(infinity);
    placed &= determinant.simd_ge(splat::<S, V>(simd, MIN_DETERMINANT_PX4));
    let cut: V = splat(simd, limits.alpha_cut);
    let mut opacity = one;
    if eye.is_over {
        opacity = one / (exp_less(simd, zero - load::<S, V>(simd, &given[OPACITY], lane), 0.0) + 1.0);
        if eye.compensated_dilation.is_some() {
            opacity *= (undilated / determinant).sqrt();
        }
        opacity *= eye.gain;
    }
    let reach = ln(simd, opacity / cut) * 2.0;
    let c = xx / determinant;
    let restart = (splat::<S, V>(simd, SAFE_EXPONENT.sqrt()) - (reach * 0.5).sqrt()) / (c * 0.5).sqrt();
    let restart = restart.max(one).min(splat::<S, V>(simd, RECURRENCE_ROWS));
    let (half_x, half_y) = ((reach * xx).sqrt(), (reach * yy).sqrt());
    let fall = c.simd_lt(splat::<S, V>(simd, WIDE)).select(zero - exp_less(simd, zero - c, 1.0), zero);
    let numbers = [u, v, one / xx, xy / xx, c, exp(simd, zero - c), fall];
    store_all(numbers, &mut out.splats[..COLOR], lane);
    store_all([opacity, cut, reach, half_x, xy / yy * half_y, restart], &mut out.splats[COLOR + 3..], lane);
    let slope_u = fma(delta, dot(m2, r0), dot(m2, cross(r1, n))) / determinant;
    let slope_v = fma(delta, dot(m2, r1), dot(m2, cross(n, r0))) / determinant;
    store_all([p[2], slope_u, slope_v], &mut out.depths, lane);

    let mut touching = touches(simd, u, half_x, limits.grid.width);
    touching &= touches(simd, v, half_y, limits.grid.height);
    let [usual, in_front, placed, opaque, touching] =
        [usual, in_front, placed, opacity.simd_ge(cut), touching].map(|mask| mask.to_bitmask());
    let all = u64::MAX >> (u64::BITS as usize - V::LEN);
    let drawable = usual & in_front & placed;
    out.near |= (usual & !in_front & all) << lane;
    out.extreme |= (!usual & all | in_front & !placed) << lane;
    out.transparent |= (drawable & !opaque) << lane;
    out.outside |= (drawable & opaque & !touching) << lane;
}

/// `bin::touches` along one axis.
#[inline(always)]
fn touches<S: Simd, V: Floats<S>>(simd: S, mean: V, half: V, side: usize) -> V::Mask {
    let (zero, side): (V, V) = (splat(simd, 0.0), splat(simd, side as f32));
    let first = (mean - half - (0.5 + SLACK)).ceil().max(zero).min(side);
    let end = ((mean + half - (0.5 - SLACK)).floor() + 1.0).max(zero).min(side);
    first.simd_lt(end)
}

/// Writes the colours of one vector's lanes; returns the lanes, as bits from 0 on, whose numbers are
/// too extreme.
#[inline(always)]
fn paint<S: Simd, V: Floats<S>>(
    simd: S,
    eye: &Eye,
    given: &Columns,
    splats: &mut [[f32; LANES]; LANES],
    lane: usize,
) -> u64 {
    let zero: V = splat(simd, 0.0);
    let mut d = [zero; 3];
    let mut usual = zero.simd_eq(zero);
    if eye.degree > 0 {
        (d, _, usual) = direction(simd, eye, load_all(simd, given, MEAN.start, lane));
    }
    let y_k = basis(simd, eye.degree, d);
    let mut color = [splat(simd, 0.5); 3];
    for k in 0..coefficients(eye.degree) {
        for channel in 0..3 {
            color[channel] = fma(load(simd, &given[SH + 3 * k + channel], lane), y_k[k], color[channel]);
        }
    }
    usual &= (color[0].abs() + color[1].abs() + color[2].abs()).simd_lt(splat::<S, V>(simd, f32::INFINITY));
    store_all(color.map(|c| c.max(zero)), &mut splats[COLOR..COLOR + 3], lane);
    (!usual).to_bitmask()
}

/// Y_k(d) for all k; 0 above `degree`.
#[inline(always)]
pub(super) fn basis<S: Simd, V: Floats<S>>(simd: S, degree: u8, [x, y, z]: [V; 3]) -> [V; MOST_COEFFICIENTS] {
    let mut y_k = [splat(simd, 0.0); MOST_COEFFICIENTS];
    y_k[0] = splat(simd, SH_C0);
    if degree == 0 {
        return y_k;
    }
    [y_k[1], y_k[2], y_k[3]] = [y * -SH_C1, z * SH_C1, x * -SH_C1];
    if degree == 1 {
        return y_k;
    }
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let ring = zz * 4.0 - xx - yy;
    y_k[4] = x * y * SH_C2[0];
    y_k[5] = y * z * SH_C2[1];
    y_k[6] = (zz * 2.0 - xx - yy) * SH_C2[2];
    y_k[7] = x * z * SH_C2[3];
    y_k[8] = (xx - yy) * SH_C2[4];
    if degree == 2 {
        return y_k;
    }
    y_k[9] = y * (xx * 3.0 - yy) * SH_C3[0];
    y_k[10] = x * y * z * SH_C3[1];
    y_k[11] = y * ring * SH_C3[2];
    y_k[12] = z * (zz * 2.0 - xx * 3.0 - yy * 3.0) * SH_C3[3];
    y_k[13] = x * ring * SH_C3[4];
    y_k[14] = z * (xx - yy) * SH_C3[5];
    y_k[15] = x * (xx - yy * 3.0) * SH_C3[6];
    y_k
}

/// The vectors of N rows from `first` on.
#[inline(always)]
pub(super) fn load_all<S: Simd, V: Floats<S>, const N: usize>(
    simd: S,
    rows: &[[f32; LANES]],
    first: usize,
    lane: usize,
) -> [V; N] {
    let mut all = [splat(simd, 0.0); N];
    for k in 0..N {
        all[k] = load(simd, &rows[first + k], lane);
    }
    all
}

/// Stores N vectors in as many rows.
#[inline(always)]
pub(super) fn store_all<S: Simd, V: Floats<S>, const N: usize>(all: [V; N], rows: &mut [[f32; LANES]], lane: usize) {
    for k in 0..N {
        store(all[k], &mut rows[k], lane);
    }
}

#[inline(always)]
pub(super) fn dot<S: Simd, V: Floats<S>>(a: [V; 3], b: [V; 3]) -> V {
    fma(a[0], b[0], fma(a[1], b[1], a[2] * b[2]))
}

#[inline(always)]
pub(super) fn cross<S: Simd, V: Floats<S>>(a: [V; 3], b: [V; 3]) -> [V; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
pub(super) fn scaled<S: Simd, V: Floats<S>>(a: [V; 3], by: V) -> [V; 3] {
    [a[0] * by, a[1] * by, a[2] * by]
}

/// a + by·b.
#[inline(always)]
pub(super) fn added<S: Simd, V: Floats<S>>(a: [V; 3], b: [V; 3], by: V) -> [V; 3] {
    [fma(b[0], by, a[0]), fma(b[1], by, a[1]), fma(b[2], by, a[2])]
}

#[inline(always)]
pub(super) fn times<S: Simd, V: Floats<S>>(a: [V; 3], b: [V; 3]) -> [V; 3] {
    [a[0] * b[0], a[1] * b[1], a[2] * b[2]]
}

/// A row vector times a matrix of these rows.
#[inline(always)]
pub(super) fn combined<S: Simd, V: Floats<S>>(row: [V; 3], matrix: &[[V; 3]; 3]) -> [V; 3] {
    added(added(scaled(matrix[0], row[0]), matrix[1], row[1]), matrix[2], row[2])
}
