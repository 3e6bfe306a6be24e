//! The values of a scene's parameters: their spread, and those that are broken.

use glam::Vec3;
use serde::Serialize;

use super::{Scene, Scene2d, Scene3d};
use crate::constants::MIN_QUATERNION_NORM2;

/// Quantiles of the finite ones of some values. Each is one of the values.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ValueQuantiles {
    /// The smallest value.
    pub min: f32,
    /// The 5 % quantile.
    #[serde(rename = "5 %")]
    pub low: f32,
    /// The 50 % quantile; of two values in the middle, the larger.
    pub median: f32,
    /// The 95 % quantile.
    #[serde(rename = "95 %")]
    pub high: f32,
    /// The largest value.
    pub max: f32,
}

impl ValueQuantiles {
    /// The quantiles of these values; `None` where none is finite.
    pub fn of(mut values: Vec<f32>) -> Option<Self> {
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
pub struct NotFinite3d {
    /// Gaussians with any such parameter.
    pub gaussians: usize,
    /// Gaussians with such a mean.
    pub means: usize,
    /// Gaussians with such a ln-scale.
    pub scales: usize,
    /// Gaussians with such a quaternion.
    pub rotations: usize,
    /// Gaussians whose opacity logit is NaN.
    pub opacities: usize,
    /// Gaussians with such an SH coefficient.
    pub colors: usize,
}

impl Scene2d {
    /// Number of Gaussians with a parameter that is NaN or infinite. An opacity of exactly 0 or 1
    /// is neither.
    pub fn not_finite(&self) -> usize {
        let finite = self.iter().filter(|g| {
            let shape = g.mean.is_finite() && g.log_scale.is_finite() && g.rotation.is_finite();
            shape && g.color.is_finite() && !g.opacity_logit.is_nan()
        });
        self.len() - finite.count()
    }
}

impl Scene3d {
    /// Smallest and largest coordinates of the finite means, world units; `None` without any.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        let finite = self.means.iter().filter(|mean| mean.is_finite());
        finite.fold(None, |bounds: Option<(Vec3, Vec3)>, &mean| {
            Some(bounds.map_or((mean, mean), |(min, max)| (min.min(mean), max.max(mean))))
        })
    }

    /// Number of Gaussians whose quaternion is too short for a rotation. They are never drawn.
    pub fn without_rotation(&self) -> usize {
        let norm2 = |q: &[f32; 4]| q.iter().map(|v| v * v).sum::<f32>();
        self.rotations.iter().filter(|q| norm2(q) < MIN_QUATERNION_NORM2).count()
    }

    /// Numbers of Gaussians with a parameter that is NaN or infinite.
    pub fn not_finite(&self) -> NotFinite3d {
        let mut count = NotFinite3d::default();
        for i in 0..self.len() {
            let colors = &self.sh[i * self.sh_len()..][..self.sh_len()];
            let broken = [
                (!self.means[i].is_finite(), &mut count.means),
                (!self.log_scales[i].is_finite(), &mut count.scales),
                (!self.rotations[i].iter().all(|v| v.is_finite()), &mut count.rotations),
                (self.opacity_logits[i].is_nan(), &mut count.opacities),
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
    use crate::scene::Gaussian3d;

    #[test]
    fn broken_values_are_counted_and_left_out_of_the_bounds() {
        let unit = [1.0, 0.0, 0.0, 0.0];
        let all = [(0.0, f32::INFINITY, unit), (f32::NAN, 0.0, [f32::NAN; 4]), (1.0, f32::NAN, [0.0; 4])];
        let gaussian = |(x, opacity_logit, rotation): (f32, f32, [f32; 4])| Gaussian3d {
            mean: Vec3::new(x, 1.0, 2.0),
            log_scale: Vec3::new(0.0, x, -1.0),
            rotation,
            opacity_logit,
            sh: vec![Vec3::ZERO],
        };
        let scene: Scene3d = all.map(gaussian).into_iter().collect();
        let expected = NotFinite3d { gaussians: 2, means: 1, scales: 1, rotations: 1, opacities: 1, colors: 0 };
        assert_eq!((scene.not_finite(), scene.without_rotation()), (expected, 1));
        assert_eq!(scene.bounds(), Some((Vec3::new(0.0, 1.0, 2.0), Vec3::new(1.0, 1.0, 2.0))));
        assert_eq!(Scene3d::default().bounds(), None);
    }

    #[test]
    fn quantiles_are_values_of_the_scene() {
        let quantiles = ValueQuantiles::of((0..101).map(|v| v as f32).collect()).unwrap();
        assert_eq!(quantiles, ValueQuantiles { min: 0.0, low: 5.0, median: 50.0, high: 95.0, max: 100.0 });
        assert_eq!(ValueQuantiles::of(vec![2.0, f32::INFINITY, 1.0]).unwrap().median, 2.0);
        assert_eq!(ValueQuantiles::of(vec![f32::NAN]), None);
    }
}
