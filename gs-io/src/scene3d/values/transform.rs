//! Transforms a scene by an affine map: for axes that differ by more than signs, and for nodes of
//! glTF.
//!
//! With p′ = A p + t, the covariance becomes A Σ Aᵀ, exactly, for any A. Colours follow the
//! rotation nearest to A.

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use gs_core::{Scene, Scene3d, constants::MIN_QUATERNION_NORM2};

use super::{flips::Flips, sh_rotation::ShRotation};
use crate::scene3d::ConversionLoss;

/// Relative tolerance with which AᵀA must be a multiple of the identity for A to count as rotation
/// and scale.
const SIMILARITY_TOLERANCE: f64 = 1e-6;

/// Largest number of sweeps of the Jacobi iteration; 5 are enough for double precision.
const SWEEPS: usize = 30;

/// Transforms every Gaussian. Returns the loss if colours cannot follow exactly. Flips are
/// bit-exact.
pub(crate) fn apply(scene: &mut Scene3d, map: &DAffine3) -> Option<ConversionLoss> {
    let (matrix, shift) = (map.matrix3, map.translation);
    if let Some(flips) = Flips::of_matrix(matrix) {
        flips.apply(scene);
        if shift != DVec3::ZERO {
            scene.means.iter_mut().for_each(|m| *m = (m.as_dvec3() + shift).as_vec3());
        }
        return None;
    }
    scene.means.iter_mut().for_each(|m| *m = map.transform_point3(m.as_dvec3()).as_vec3());
    let decomposition = Svd::of(matrix);
    let nearest = decomposition.u * decomposition.v.transpose();
    let reflects = nearest.determinant() < 0.0;
    let turn = DQuat::from_mat3(&if reflects { -nearest } else { nearest });
    let size = decomposition.s.element_sum() / 3.0;
    let similar = (decomposition.s - size).abs().max_element() <= SIMILARITY_TOLERANCE * size;
    for i in 0..scene.len() {
        let [w, x, y, z] = scene.rotations[i].map(f64::from);
        let q = DQuat::from_xyzw(x, y, z, w);
        if similar && size > 0.0 {
            scene.log_scales[i] = (scene.log_scales[i].as_dvec3() + size.ln()).as_vec3();
            scene.rotations[i] = wxyz(turn * q);
        } else if q.length_squared() >= f64::from(MIN_QUATERNION_NORM2) {
            let scales = scene.log_scales[i].as_dvec3().map(f64::exp);
            let Svd { u, s, .. } = Svd::of(matrix * DMat3::from_quat(q.normalize()) * DMat3::from_diagonal(scales));
            scene.log_scales[i] = s.map(log_of_axis).as_vec3();
            // The sign of an ellipsoid's axis does not matter.
            let proper = if u.determinant() < 0.0 { DMat3::from_cols(u.x_axis, u.y_axis, -u.z_axis) } else { u };
            scene.rotations[i] = wxyz(DQuat::from_mat3(&proper));
        }
    }
    let sh_rotation = ShRotation::new(DMat3::from_quat(turn));
    let len = scene.sh_len();
    scene.sh.chunks_exact_mut(len).for_each(|coefficients: &mut [Vec3]| {
        sh_rotation.apply(coefficients);
        if reflects {
            // A reflection is a rotation times −1, which changes the sign of odd degrees.
            let odd = (1..len).filter(|&k| matches!(k, 1..4 | 9..16));
            odd.for_each(|k| coefficients[k] = -coefficients[k]);
        }
    });
    (!similar).then_some(ConversionLoss::Stretched)
}

/// ln of the length of an axis, as [`log_of_scale`](super::quantity::log_of_scale) has it.
fn log_of_axis(length: f64) -> f64 {
    if length > 0.0 { length.max(f64::from(f32::MIN_POSITIVE)).ln() } else { f64::NEG_INFINITY }
}

fn wxyz(q: DQuat) -> [f32; 4] {
    [q.w, q.x, q.y, q.z].map(|v| v as f32)
}

/// A = U diag(s) Vᵀ with s ≥ 0 in any order; U and V are orthogonal, whatever A's rank.
struct Svd {
    u: DMat3,
    s: DVec3,
    v: DMat3,
}

impl Svd {
    /// Computes the decomposition by Hestenes's one-sided Jacobi iteration, which keeps the full
    /// relative accuracy of a needle's short axis.
    fn of(matrix: DMat3) -> Self {
        let mut b = matrix.to_cols_array_2d().map(DVec3::from);
        let mut v = DMat3::IDENTITY.to_cols_array_2d().map(DVec3::from);
        for _ in 0..SWEEPS {
            let mut turned = false;
            for (p, q) in [(0, 1), (0, 2), (1, 2)] {
                let (alpha, beta, gamma) = (b[p].length_squared(), b[q].length_squared(), b[p].dot(b[q]));
                if !(gamma.abs() > f64::EPSILON * (alpha * beta).sqrt()) {
                    continue;
                }
                turned = true;
                let zeta = (beta - alpha) / (2.0 * gamma);
                let tangent = zeta.signum() / (zeta.abs() + zeta.hypot(1.0));
                let cos = 1.0 / tangent.hypot(1.0);
                let sin = cos * tangent;
                for m in [&mut b, &mut v] {
                    (m[p], m[q]) = (m[p] * cos - m[q] * sin, m[p] * sin + m[q] * cos);
                }
            }
            if !turned {
                break;
            }
        }
        let s = DVec3::from(b.map(DVec3::length));
        Self { u: orthonormal(b), s, v: DMat3::from_cols(v[0], v[1], v[2]) }
    }
}

/// Normalises orthogonal columns; columns of length 0 are replaced.
fn orthonormal(columns: [DVec3; 3]) -> DMat3 {
    let mut units = columns.map(DVec3::try_normalize);
    for k in 0..3 {
        if units[k].is_none() {
            let (next, last) = (units[(k + 1) % 3], units[(k + 2) % 3]);
            units[k] = Some(match (next, last) {
                (Some(a), Some(b)) => a.cross(b),
                (Some(a), None) | (None, Some(a)) => a.any_orthonormal_vector(),
                (None, None) => DVec3::AXES[k],
            });
        }
    }
    let [a, b, c] = units.map(Option::unwrap_or_default);
    DMat3::from_cols(a, b, c)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene3d::whole::raise_zero_scales;
    use gs_core::Gaussian3d;

    fn scene() -> Scene3d {
        let mut scene = Scene3d { sh_degree: 3, ..Scene3d::default() };
        for k in 0..4 {
            let t = k as f32;
            scene.push(Gaussian3d {
                mean: Vec3::new(1.0 + t, -2.0, 0.5 * t),
                log_scale: Vec3::new(-1.0, -8.0 + t, 0.3),
                rotation: [0.3, t, -0.7, 2.0],
                opacity_logit: 0.0,
                sh: (0..16).map(|i| Vec3::new((i as f32 + t).sin(), (2.3 * i as f32).cos(), 0.1 * i as f32)).collect(),
            });
        }
        scene
    }

    /// Checks that each covariance is A Σ Aᵀ.
    fn check_covariances(map: DMat3) {
        let before = scene();
        let mut after = before.clone();
        apply(&mut after, &DAffine3::from_mat3_translation(map, DVec3::new(3.0, 4.0, 5.0)));
        for i in 0..before.len() {
            let frame = map * before.gaussian(i).factor().unwrap().as_dmat3();
            let expected = frame * frame.transpose();
            let found = after.gaussian(i).covariance().unwrap().as_dmat3();
            let tolerance = 2e-6 * expected.to_cols_array().iter().fold(0.0, |m: f64, v| m.max(v.abs()));
            assert!(found.abs_diff_eq(expected, tolerance), "{map}\n{found}\n{expected}");
            let mean = map * before.means[i].as_dvec3() + DVec3::new(3.0, 4.0, 5.0);
            assert!(after.means[i].as_dvec3().abs_diff_eq(mean, 1e-5));
        }
    }

    #[test]
    fn covariances_follow_any_map() {
        let turn = DMat3::from_rotation_y(0.7) * DMat3::from_rotation_x(-2.0);
        check_covariances(turn);
        check_covariances(turn * 3.0);
        check_covariances(-turn);
        check_covariances(DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)));
        check_covariances(turn * DMat3::from_diagonal(DVec3::new(1.0, 20.0, -0.1)));
        check_covariances(DMat3::from_cols(DVec3::X, DVec3::new(5.0, 1.0, 0.0), DVec3::new(0.0, 2.0, 1.0)));
    }

    #[test]
    fn a_map_that_flattens_leaves_a_finite_scene() {
        for map in [
            DMat3::from_diagonal(DVec3::new(1.0, 0.0, 2.0)),
            DMat3::ZERO,
            DMat3::from_cols(DVec3::X, DVec3::X, DVec3::X),
        ] {
            let mut flat = scene();
            assert_eq!(
                apply(&mut flat, &DAffine3::from_mat3(map)),
                Some(ConversionLoss::Stretched).filter(|_| map != DMat3::ZERO)
            );
            // Axes of length 0 are visible to unchecked readers; other readers raise them.
            assert!(flat.log_scales.iter().all(|s| s.to_array().contains(&f32::NEG_INFINITY)));
            raise_zero_scales(&mut flat).expect("scales of 0");
            flat.validate().unwrap();
        }
    }

    #[test]
    fn turning_axes_twice_is_nothing_to_the_bit() {
        let mut turned = scene();
        turned.means[0].x = -0.0;
        let before = turned.clone();
        let map = DAffine3::from_mat3(DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0)));
        for _ in 0..2 {
            assert_eq!(apply(&mut turned, &map), None);
        }
        assert_eq!(format!("{turned:?}"), format!("{before:?}"));
    }

    #[test]
    fn turned_axes_and_the_general_way_agree() {
        let signs = DVec3::new(1.0, -1.0, -1.0);
        let (mut exact, mut general) = (scene(), scene());
        apply(&mut exact, &DAffine3::from_mat3(DMat3::from_diagonal(signs)));
        // A rotation by π about x whose sine is not exactly 0.
        apply(&mut general, &DAffine3::from_mat3(DMat3::from_rotation_x(std::f64::consts::PI)));
        for (a, b) in exact.sh.iter().zip(&general.sh) {
            assert!(a.abs_diff_eq(*b, 1e-5), "{a} {b}");
        }
        for i in 0..exact.len() {
            let (a, b) = (exact.gaussian(i).covariance().unwrap(), general.gaussian(i).covariance().unwrap());
            assert!(a.abs_diff_eq(b, 1e-5), "{a} {b}");
        }
    }
}
