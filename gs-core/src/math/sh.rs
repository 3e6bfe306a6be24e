//! Colour by direction: real spherical harmonics (SH) up to degree 3, with the constants, signs and
//! order of 3DGS, and their derivatives.
//!
//! Legend: d = unit vector from the camera to the Gaussian's mean, world axes; Y_k = basis
//! function; `v_x` = ∂L/∂x.

use glam::Vec3;

use crate::constants::{SH_C0, SH_C1, SH_C2, SH_C3};

/// Number of coefficients up to degree 3, the highest.
pub const MOST_COEFFICIENTS: usize = 16;

/// Number of coefficients up to a degree: K = (degree + 1)².
pub fn coefficients(degree: u8) -> usize {
    (usize::from(degree) + 1).pow(2)
}

/// Y_k(d) for all k; 0 above `degree`.
#[inline(always)]
pub(crate) fn basis(degree: u8, d: Vec3) -> [f32; MOST_COEFFICIENTS] {
    let mut y_k = [0.0; MOST_COEFFICIENTS];
    y_k[0] = SH_C0;
    if degree == 0 {
        return y_k;
    }
    let Vec3 { x, y, z } = d;
    [y_k[1], y_k[2], y_k[3]] = [-SH_C1 * y, SH_C1 * z, -SH_C1 * x];
    if degree == 1 {
        return y_k;
    }
    let (xx, yy, zz) = (x * x, y * y, z * z);
    y_k[4] = SH_C2[0] * (x * y);
    y_k[5] = SH_C2[1] * (y * z);
    y_k[6] = SH_C2[2] * (2.0 * zz - xx - yy);
    y_k[7] = SH_C2[3] * (x * z);
    y_k[8] = SH_C2[4] * (xx - yy);
    if degree == 2 {
        return y_k;
    }
    y_k[9] = SH_C3[0] * y * (3.0 * xx - yy);
    y_k[10] = SH_C3[1] * (x * y) * z;
    y_k[11] = SH_C3[2] * y * (4.0 * zz - xx - yy);
    y_k[12] = SH_C3[3] * z * (2.0 * zz - 3.0 * xx - 3.0 * yy);
    y_k[13] = SH_C3[4] * x * (4.0 * zz - xx - yy);
    y_k[14] = SH_C3[5] * z * (xx - yy);
    y_k[15] = SH_C3[6] * x * (xx - 3.0 * yy);
    y_k
}

/// Bound, over all directions, on the change of a channel of ½ + SH where all coefficients above
/// `degree` are left out; `sh` holds the coefficients of one Gaussian, whole degrees.
///
/// It is Σ √((2l + 1)/4π)·‖coefficients of degree l‖ over the degrees l left out, as Σ Y_k² = (2l +
/// 1)/4π over a degree's functions in every direction (Unsöld's theorem) and by the inequality of
/// Cauchy and Schwarz.
pub(crate) fn change_bound(degree: u8, sh: &[Vec3]) -> f32 {
    let kept = usize::from(degree) + 1;
    let mut sum = Vec3::ZERO;
    for l in kept..kept + 3 {
        let Some(of_degree) = sh.get(l * l..(l + 1) * (l + 1)) else { break };
        let norm2 = of_degree.iter().fold(Vec3::ZERO, |sum, &c| sum + c * c);
        let factor = (2 * l + 1) as f32 / (4.0 * std::f32::consts::PI);
        sum += (norm2 * factor).map(f32::sqrt);
    }
    sum.max_element()
}

/// Σ a_k ∇Y_k(d) by the three components of d as if they were free; the caller keeps the tangential
/// part.
#[inline(always)]
fn weighted_gradients(degree: u8, d: Vec3, a: &[f32; MOST_COEFFICIENTS]) -> Vec3 {
    if degree == 0 {
        return Vec3::ZERO;
    }
    let Vec3 { x, y, z } = d;
    let mut sum = Vec3::new(-a[3], -a[1], a[2]) * SH_C1;
    if degree == 1 {
        return sum;
    }
    let [xy, yz, zz, xz, xx] = [0, 1, 2, 3, 4].map(|k| a[4 + k] * SH_C2[k]);
    sum += Vec3::new(
        xy * y - 2.0 * zz * x + xz * z + 2.0 * xx * x,
        xy * x + yz * z - 2.0 * zz * y - 2.0 * xx * y,
        yz * y + 4.0 * zz * z + xz * x,
    );
    if degree == 2 {
        return sum;
    }
    let b: [f32; 7] = std::array::from_fn(|k| a[9 + k] * SH_C3[k]);
    let (x2, y2, z2) = (x * x, y * y, z * z);
    let ring = 4.0 * z2 - x2 - y2;
    sum + Vec3::new(
        6.0 * b[0] * x * y + b[1] * y * z - 2.0 * b[2] * x * y - 6.0 * b[3] * x * z
            + b[4] * (ring - 2.0 * x2)
            + 2.0 * b[5] * x * z
            + 3.0 * b[6] * (x2 - y2),
        3.0 * b[0] * (x2 - y2) + b[1] * x * z + b[2] * (ring - 2.0 * y2)
            - 6.0 * b[3] * y * z
            - 2.0 * b[4] * x * y
            - 2.0 * b[5] * y * z
            - 6.0 * b[6] * x * y,
        b[1] * x * y + 8.0 * b[2] * y * z + 3.0 * b[3] * (2.0 * z2 - x2 - y2) + 8.0 * b[4] * x * z + b[5] * (x2 - y2),
    )
}

/// Colour c = max(0, ½ + Σ Y_k(d) sh_k), channel by channel; `sh` holds at least the coefficients
/// of `degree`, as [`Vec3`] or arrays. Values that are not finite stay so, −∞ too, so that they are
/// noticed and not drawn as black.
#[inline(always)]
pub fn color<C: Copy + Into<Vec3>>(degree: u8, d: Vec3, sh: &[C]) -> [f32; 3] {
    let y_k = basis(degree, d);
    let sum = sh[..coefficients(degree)].iter().zip(y_k).fold(Vec3::splat(0.5), |sum, (&c, y)| sum + c.into() * y);
    sum.to_array().map(|c| if (f32::MIN..0.0).contains(&c) { 0.0 } else { c })
}

/// (v_d, v_sh) from v_c: returns v_d, not projected to the tangent, and writes v_sh to the first
/// (degree + 1)² of `v_sh`. Channels whose colour is clamped, where ½ + SH ≤ 0, have no gradient.
#[inline(always)]
pub fn color_vjp<C>(degree: u8, d: Vec3, sh: &[C], v_color: [f32; 3], v_sh: &mut [C]) -> Vec3
where
    C: Copy + Into<Vec3> + From<Vec3>,
{
    let y_k = basis(degree, d);
    let sh = &sh[..coefficients(degree)];
    let sum = sh.iter().zip(y_k).fold(Vec3::splat(0.5), |sum, (&c, y)| sum + c.into() * y);
    let v = Vec3::select(sum.cmpgt(Vec3::ZERO), Vec3::from_array(v_color), Vec3::ZERO);
    let mut a = [0.0; MOST_COEFFICIENTS];
    for (k, (&c, v_c)) in sh.iter().zip(v_sh).enumerate() {
        *v_c = C::from(v * y_k[k]);
        a[k] = c.into().dot(v);
    }
    weighted_gradients(degree, d, &a)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn coefficients_of_a_test() -> Vec<Vec3> {
        let at = |k: usize, c: usize| ((k * 7 + c * 3) % 11) as f32 / 11.0 - 0.45;
        (0..MOST_COEFFICIENTS).map(|k| Vec3::new(at(k, 0), at(k, 1), at(k, 2))).collect()
    }

    #[test]
    fn basis_functions_are_orthonormal_on_the_sphere() {
        // The product of two is a polynomial of degree 6, for which a grid of Gauss–Legendre by
        // uniform angles is exact.
        let nodes = [(0.0, 0.568_888_9), (0.538_469_3, 0.478_628_67), (0.906_179_85, 0.236_926_88)];
        let mut gram = [[0.0f64; MOST_COEFFICIENTS]; MOST_COEFFICIENTS];
        for (node, weight) in
            nodes.into_iter().flat_map(|(n, w)| if n == 0.0 { vec![(n, w)] } else { vec![(n, w), (-n, w)] })
        {
            for i in 0..12 {
                let angle = std::f32::consts::TAU * i as f32 / 12.0;
                let radius = (1.0f32 - node * node).sqrt();
                let y = basis(3, Vec3::new(radius * angle.cos(), radius * angle.sin(), node));
                for (row, a) in gram.iter_mut().zip(y) {
                    for (entry, b) in row.iter_mut().zip(y) {
                        *entry += f64::from(a * b * weight) * std::f64::consts::TAU / 12.0;
                    }
                }
            }
        }
        for (k, row) in gram.iter().enumerate() {
            for (l, &entry) in row.iter().enumerate() {
                let expected = if k == l { 1.0 } else { 0.0 };
                assert!((entry - expected).abs() < 1e-5, "{k} {l}: {entry}");
            }
        }
    }

    #[test]
    fn derivatives_are_those_of_the_color() {
        let sh = coefficients_of_a_test();
        let (d, v_color) = (Vec3::new(0.48, -0.6, 0.64), [0.7, -0.4, 0.9]);
        for degree in 0..=3 {
            let loss =
                |d: Vec3, sh: &[Vec3]| -> f32 { color(degree, d, sh).iter().zip(v_color).map(|(c, v)| c * v).sum() };
            let mut v_sh = vec![Vec3::NAN; coefficients(degree)];
            let v_d = color_vjp(degree, d, &sh, v_color, &mut v_sh);
            for axis in 0..3 {
                let h = Vec3::AXES[axis] * 1e-2;
                let numeric = (loss(d + h, &sh) - loss(d - h, &sh)) / 2e-2;
                assert!((v_d[axis] - numeric).abs() < 1e-3, "degree {degree}, axis {axis}: {} {numeric}", v_d[axis]);
            }
            for k in 0..coefficients(degree) {
                for channel in 0..3 {
                    let (mut up, mut down) = (sh.clone(), sh.clone());
                    up[k][channel] += 1e-2;
                    down[k][channel] -= 1e-2;
                    let numeric = (loss(d, &up) - loss(d, &down)) / 2e-2;
                    assert!((v_sh[k][channel] - numeric).abs() < 1e-4, "degree {degree}, coefficient {k}");
                }
            }
        }
    }

    #[test]
    fn clamped_channels_pass_nothing_on() {
        let sh = [Vec3::new(-4.0, 1.0, 1.0)];
        assert_eq!(color(0, Vec3::Z, &sh)[0], 0.0);
        let mut v_sh = [Vec3::NAN];
        color_vjp(0, Vec3::Z, &sh, [1.0; 3], &mut v_sh);
        assert_eq!(v_sh[0], Vec3::new(0.0, SH_C0, SH_C0));
        for broken in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert!(!color(0, Vec3::Z, &[Vec3::splat(broken)]).iter().any(|c| c.is_finite()), "{broken}");
        }
    }
}
