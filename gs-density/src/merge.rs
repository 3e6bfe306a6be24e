//! One Gaussian in place of several, with their moments.

use glam::{DMat3, DQuat, DVec3, Vec3};
use gs_core::{Gaussian3d, logit, sigmoid};

use crate::eigen;

/// The highest opacity of a merged Gaussian: that at which alpha is cut in rendering.
const MOST_OPACITY: f32 = 0.99;

/// The smallest variance of a merged Gaussian, square world units.
const LEAST_VARIANCE: f64 = 1e-30;

/// Merges Gaussians with weights above 0, of which the first is the main one: the result has the
/// weighted mean, covariance and coefficients of all.
///
/// Its opacity is that of the main one, scaled by what the weights say is drawn and by the area that
/// it is drawn over: o = o₀ (Σw / w₀) (A₀ / A), at most 0.99, with A the product of the two larger
/// standard deviations. `None` for a Gaussian without a rotation, or values that are not finite.
pub fn merged(parts: &[(Gaussian3d, f64)]) -> Option<Gaussian3d> {
    let (main, main_weight) = parts.first()?;
    let total: f64 = parts.iter().map(|(_, weight)| weight).sum();
    let mean = parts.iter().map(|(part, weight)| part.mean.as_dvec3() * *weight).sum::<DVec3>() / total;
    let mut covariance = DMat3::ZERO;
    let mut sh = vec![Vec3::ZERO; main.sh.len()];
    for (part, weight) in parts {
        let share = weight / total;
        let offset = part.mean.as_dvec3() - mean;
        let spread = DMat3::from_cols(offset * offset.x, offset * offset.y, offset * offset.z);
        covariance += (part.covariance()?.as_dmat3() + spread) * share;
        sh.iter_mut().zip(&part.sh).for_each(|(sum, &c)| *sum += c * share as f32);
    }
    let (variances, mut axes) = eigen::decomposed(covariance);
    if axes.determinant() < 0.0 {
        axes.x_axis = -axes.x_axis;
    }
    let scale = variances.map(|variance| variance.max(LEAST_VARIANCE).sqrt());
    let area = |scale: DVec3| scale.x * scale.y * scale.z / scale.min_element();
    let main_area = area(main.log_scale.as_dvec3().map(f64::exp));
    let opacity = f64::from(sigmoid(main.opacity_logit)) * (total / main_weight) * (main_area / area(scale));
    let q = DQuat::from_mat3(&axes).normalize();
    let gaussian = Gaussian3d {
        mean: mean.as_vec3(),
        log_scale: scale.map(f64::ln).as_vec3(),
        rotation: [q.w, q.x, q.y, q.z].map(|v| v as f32),
        opacity_logit: logit((opacity as f32).clamp(f32::MIN_POSITIVE, MOST_OPACITY)),
        sh,
    };
    let numbers = gaussian.rotation.into_iter().chain(gaussian.log_scale.to_array()).chain(gaussian.mean.to_array());
    numbers.chain([gaussian.opacity_logit]).all(f32::is_finite).then_some(gaussian)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gaussian(mean: Vec3, color: f32) -> Gaussian3d {
        Gaussian3d {
            mean,
            log_scale: Vec3::new(0.0, -1.0, -2.0),
            rotation: [0.8, 0.0, 0.6, 0.0],
            opacity_logit: 0.0,
            sh: vec![Vec3::splat(color)],
        }
    }

    #[test]
    fn a_gaussian_and_its_copy_become_the_same_shape_with_more_opacity() {
        let one = gaussian(Vec3::new(1.0, 2.0, 3.0), 0.5);
        let both = merged(&[(one.clone(), 2.0), (one.clone(), 1.0)]).unwrap();
        assert!(both.mean.abs_diff_eq(one.mean, 1e-6));
        assert!(both.covariance().unwrap().abs_diff_eq(one.covariance().unwrap(), 1e-5));
        assert!((sigmoid(both.opacity_logit) - 0.75).abs() < 1e-5);
    }

    #[test]
    fn moments_of_two_are_kept() {
        let parts = [(gaussian(Vec3::X, 0.0), 3.0), (gaussian(-Vec3::X, 1.0), 1.0)];
        let one = merged(&parts).unwrap();
        assert!(one.mean.abs_diff_eq(Vec3::X * 0.5, 1e-6));
        assert!((one.sh[0].x - 0.25).abs() < 1e-6);
        // The variance between ±1 with weights 3 and 1 is 3/4.
        let spread = one.covariance().unwrap().x_axis.x - parts[0].0.covariance().unwrap().x_axis.x;
        assert!((spread - 0.75).abs() < 1e-5, "{spread}");
        // What is wider is fainter.
        assert!(sigmoid(one.opacity_logit) < 0.5 * 4.0 / 3.0);
    }

    #[test]
    fn a_gaussian_without_a_rotation_is_not_merged() {
        let mut broken = gaussian(Vec3::ZERO, 0.0);
        broken.rotation = [0.0; 4];
        assert_eq!(merged(&[(gaussian(Vec3::ZERO, 0.0), 1.0), (broken, 1.0)]), None);
    }
}
