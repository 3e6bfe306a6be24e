//! A scene with fewer Gaussians, in a fraction of the time that merging them takes.

use glam::Vec3;

use super::{Scene, Scene3d, sigmoid};

/// The largest factor by which a Gaussian grows to stand for others.
const MOST_GROWTH: f32 = 3.0;

/// Number of Gaussians from which the threshold is estimated.
const SAMPLES: usize = 50_000;

impl Scene3d {
    /// What each Gaussian covers: its area (of the two longest axes) times its opacity, world units squared; above 0.
    pub fn coverage(&self) -> Vec<f32> {
        let covered = |(scale, logit): (&Vec3, &f32)| {
            (sigmoid(*logit) * (scale.element_sum() - scale.min_element()).exp()).max(f32::MIN_POSITIVE)
        };
        self.log_scales.iter().zip(&self.opacity_logits).map(covered).collect()
    }

    /// Returns about `count` of the Gaussians, for pictures that must come soon, or all if there are no more.
    ///
    /// Each Gaussian has a share, which is in proportion to its weight, and at most 1. The shares are summed in order; a
    /// Gaussian stays if the sum passes a whole number at its share. The area of a Gaussian that stays grows by the
    /// inverse of its share, its length at most threefold. With [`coverage`](Self::coverage) as weights, the covered
    /// area stays the same on average, except for shares below a ninth. Coverage divided by the squared distance from a
    /// camera is in proportion to the area in its picture.
    ///
    /// Neighbours in memory should be neighbours in space, as in a SOG. The Gaussians that stay are then evenly spread.
    ///
    /// *Source:* Cook, Halstead, Planck and Ryu, "Stochastic Simplification of Aggregate Detail" (2007): some elements
    /// are left out, and the others get larger. In that paper all elements have the same share; shares by size are
    /// those of systematic sampling in proportion to size (Madow 1949).
    #[must_use]
    pub fn thinned(&self, count: usize, weight: impl Fn(usize) -> f32) -> Self {
        if self.len() <= count {
            return self.clone();
        }
        let samples: Vec<f32> = (0..self.len()).step_by(self.len().div_ceil(SAMPLES)).map(&weight).collect();
        let threshold = threshold(&samples, count as f32 / self.len() as f32);
        let mut thin = Self { sh_degree: self.sh_degree, ..Self::default() };
        let (len, mut sum) = (self.sh_len(), 0.5);
        for i in 0..self.len() {
            let share = (weight(i) / threshold).min(1.0);
            sum += share;
            if sum < 1.0 {
                continue;
            }
            sum -= 1.0;
            thin.means.push(self.means[i]);
            thin.log_scales.push(self.log_scales[i] - 0.5 * share.max(MOST_GROWTH.powi(-2)).ln());
            thin.rotations.push(self.rotations[i]);
            thin.opacity_logits.push(self.opacity_logits[i]);
            thin.sh.extend(&self.sh[len * i..len * (i + 1)]);
        }
        thin
    }
}

/// The value t for which the mean of min(v / t, 1) is this share.
fn threshold(values: &[f32], share: f32) -> f32 {
    let kept = |t: f32| values.iter().map(|v| f64::from((v / t).min(1.0))).sum::<f64>() / values.len() as f64;
    let (mut low, mut high) = (f32::MIN_POSITIVE.ln(), f32::MAX.ln());
    for _ in 0..40 {
        let middle = low.midpoint(high);
        if kept(middle.exp()) > f64::from(share) { low = middle } else { high = middle }
    }
    high.exp()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Gaussian3d;

    fn thinned(scene: &Scene3d, count: usize) -> Scene3d {
        let coverage = scene.coverage();
        scene.thinned(count, |i| coverage[i])
    }

    /// Small Gaussians in a row, and every hundredth large.
    fn row() -> Scene3d {
        let gaussian = |i: usize| Gaussian3d {
            mean: Vec3::new(i as f32, 0.0, 0.0),
            log_scale: if i % 100 == 50 { Vec3::new(1.0, 1.0, -6.0) } else { Vec3::new(-2.0, -2.0, -6.0) },
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit: 2.0,
            sh: vec![Vec3::splat(i as f32); 4],
        };
        (0..10_000).map(gaussian).collect()
    }

    #[test]
    fn a_thinned_scene_has_the_count_and_covers_as_much_everywhere() {
        let scene = row();
        let thin = thinned(&scene, 2000);
        assert!((1990..=2010).contains(&thin.len()), "{}", thin.len());
        assert!(thin.validate().is_ok() && thin.sh_degree == 1);
        // Large ones stay as they are, and small ones grow.
        let large: Vec<_> = thin.log_scales.iter().filter(|s| s.x >= 1.0).collect();
        assert_eq!(large.len(), 100);
        assert!(large.iter().all(|s| **s == Vec3::new(1.0, 1.0, -6.0)));
        let area = |scene: &Scene3d, from: f32| -> f32 {
            let inside = |i: &usize| (from..from + 1000.0).contains(&scene.means[*i].x) && scene.log_scales[*i].x < 1.0;
            (0..scene.len()).filter(inside).map(|i| (scene.log_scales[i].x + scene.log_scales[i].y).exp()).sum()
        };
        for from in [0.0, 3000.0, 9000.0] {
            let (before, after) = (area(&scene, from), area(&thin, from));
            assert!((after / before - 1.0).abs() < 0.02, "{before} {after}");
        }
        // Each has the values of one that was there.
        assert!(thin.means.iter().zip(thin.sh.chunks(4)).all(|(mean, sh)| sh == [Vec3::splat(mean.x); 4]));
        // Those with a share below a ninth grow threefold.
        let few = thinned(&scene, 300);
        assert!((290..=310).contains(&few.len()), "{}", few.len());
        let small = few.log_scales.iter().filter(|s| s.z < -3.0 && s.x < 0.5);
        assert!(small.clone().count() > 100 && small.clone().all(|s| (s.x - (-2.0 + 3.0_f32.ln())).abs() < 1e-5));
        // Opaque ones stay rather than others.
        let mut pale = scene.clone();
        pale.opacity_logits[5000..].fill(-3.0);
        let thin = thinned(&pale, 2000);
        let (left, right) = (thin.means.iter().filter(|m| m.x < 5000.0).count(), thin.len());
        assert!(left > 3 * (right - left), "{left} of {right}");
        // With distances, more stay nearby.
        let coverage = scene.coverage();
        let near = scene.thinned(2000, |i| coverage[i] / (1.0 + scene.means[i].x).powi(2));
        assert!(near.means.iter().filter(|mean| mean.x < 1000.0).count() > 900);
        assert_eq!(thinned(&scene, 10_000), scene);
        assert_eq!(thinned(&scene, 0).len(), 0);
    }
}
