//! The values of a scene's parameters: their spread, and those that are broken.

use glam::Vec3;
use gs_core::{Scene as _, Scene2d, Scene3d, constants::MIN_QUATERNION_NORM2};
use serde::Serialize;

/// Quantiles of the finite ones of some values. Each is one of the values.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct ValueQuantiles {
    /// The smallest value.
    pub(super) min: f32,
    /// The 5 % quantile.
    #[serde(rename = "5 %")]
    pub(super) low: f32,
    /// The 50 % quantile; of two values in the middle, the larger.
    pub(super) median: f32,
    /// The 95 % quantile.
    #[serde(rename = "95 %")]
    pub(super) high: f32,
    /// The largest value.
    pub(super) max: f32,
}

impl ValueQuantiles {
    /// The quantiles of these values; `None` where none is finite.
    pub(super) fn of(mut values: Vec<f32>) -> Option<Self> {
        values.retain(|v| v.is_finite());
        values.sort_by(f32::total_cmp);
        let last = values.len().checked_sub(1)?;
        let at = |share: f32| values[(share * last as f32).round() as usize];
        Some(Self { min: at(0.0), low: at(0.05), median: values[values.len() / 2], high: at(0.95), max: values[last] })
    }
}

/// Numbers of Gaussians of a [`Scene3d`] with a parameter that is NaN or infinite, by parameter. An
/// opacity of exactly 0 or 1 is neither.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub(super) struct NotFinite3d {
    /// Gaussians with any such parameter.
    pub(super) gaussians: usize,
    /// Gaussians with such a mean.
    pub(super) means: usize,
    /// Gaussians with such a ln-scale.
    pub(super) scales: usize,
    /// Gaussians with such a quaternion.
    pub(super) rotations: usize,
    /// Gaussians whose opacity logit is NaN.
    pub(super) opacities: usize,
    /// Gaussians with such an SH coefficient.
    pub(super) colors: usize,
}

/// Number of Gaussians with a parameter that is NaN or infinite. An opacity of exactly 0 or 1 is
/// neither.
pub(super) fn not_finite_2d(scene: &Scene2d) -> usize {
    let finite = scene.iter().filter(|g| {
        let shape = g.mean.is_finite() && g.log_scale.is_finite() && g.rotation.is_finite();
        shape && g.color.is_finite() && !g.opacity_logit.is_nan()
    });
    scene.len() - finite.count()
}

/// Smallest and largest coordinates of the finite means, world units; `None` without any.
pub(super) fn bounds(scene: &Scene3d) -> Option<(Vec3, Vec3)> {
    let finite = scene.means.iter().filter(|mean| mean.is_finite());
    finite.fold(None, |bounds: Option<(Vec3, Vec3)>, &mean| {
        Some(bounds.map_or((mean, mean), |(min, max)| (min.min(mean), max.max(mean))))
    })
}

/// Number of Gaussians whose quaternion is too short for a rotation. They are never drawn.
pub(super) fn without_rotation(scene: &Scene3d) -> usize {
    let norm2 = |q: &[f32; 4]| q.iter().map(|v| v * v).sum::<f32>();
    scene.rotations.iter().filter(|q| norm2(q) < MIN_QUATERNION_NORM2).count()
}

impl NotFinite3d {
    /// Numbers of Gaussians with a parameter that is NaN or infinite.
    pub(super) fn of(scene: &Scene3d) -> Self {
        let mut count = Self::default();
        for i in 0..scene.len() {
            let colors = &scene.sh[i * scene.sh_len()..][..scene.sh_len()];
            let broken = [
                (!scene.means[i].is_finite(), &mut count.means),
                (!scene.log_scales[i].is_finite(), &mut count.scales),
                (!scene.rotations[i].iter().all(|v| v.is_finite()), &mut count.rotations),
                (scene.opacity_logits[i].is_nan(), &mut count.opacities),
                (!colors.iter().all(|c| c.is_finite()), &mut count.colors),
            ];
            let mut any = false;
            for (is_broken, counter) in broken {
                *counter += usize::from(is_broken);
                any |= is_broken;
            }
            count.gaussians += usize::from(any);
        }
        count
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_values_of_the_scene() {
        let quantiles = ValueQuantiles::of((0..101).map(|v| v as f32).collect()).unwrap();
        assert_eq!(quantiles, ValueQuantiles { min: 0.0, low: 5.0, median: 50.0, high: 95.0, max: 100.0 });
        assert_eq!(ValueQuantiles::of(vec![2.0, f32::INFINITY, 1.0]).unwrap().median, 2.0);
        assert_eq!(ValueQuantiles::of(vec![f32::NAN]), None);
    }

    #[test]
    fn bounds_are_those_of_finite_means() {
        let means = vec![Vec3::new(1.0, -2.0, 3.0), Vec3::new(0.0, f32::NAN, 9.0), Vec3::new(-1.0, 5.0, 3.0)];
        let scene = Scene3d { means, ..Scene3d::default() };
        assert_eq!(bounds(&scene), Some((Vec3::new(-1.0, -2.0, 3.0), Vec3::new(1.0, 5.0, 3.0))));
        assert_eq!(bounds(&Scene3d::default()), None);
    }
}
