//! The descent of one camera along the gradients of its steps.
//!
//! A turn and a shift of a camera often move its image nearly alike, and in different units. The six
//! numbers of the twist are therefore whitened: in the new coordinates, a step of length 1 moves the
//! scene's points in the image by 1 px (root mean square) in whatever direction it goes. *Source:* Park
//! et al. 2023, *CamP: Camera Preconditioning for Neural Radiance Fields*. Each step is one of
//! Adam, with one second moment for all six numbers, which does not depend on the choice of axes. It is
//! shorter where the last gradients disagree.

use glam::{DQuat, DVec2, DVec3, Vec3};
use gs_core::{Camera, CameraGradient};
use serde::{Deserialize, Serialize};

use super::align::{factored, flow};

/// Decay of the first moment. A camera has only dozens of steps.
const BETA1: f64 = 0.7;

/// Decay of the second moment.
const BETA2: f64 = 0.9;

/// Damping of the whitening relative to the diagonal of its matrix: points at nearly one depth do not tell
/// some turns from shifts.
const DAMPING: f64 = 0.1;

/// Least number of points in sight of a camera that moves.
const LEAST_POINTS: usize = 10;

/// Most points that are used.
const MOST_POINTS: usize = 2_000;

/// The state of a camera's descent, as stored in checkpoints.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub(super) struct Descent {
    /// The rows of L, one after the other: the points' mean squared motion by the twist t is |Lᵀ t|², px².
    /// Empty for a camera that does not move.
    whitening: Vec<f64>,
    /// First moment of the whitened gradient.
    first: [f64; 6],
    /// Second moment of a component, mean over the six.
    second: f64,
    /// Steps done.
    steps: u32,
}

impl Descent {
    /// The beginning, of a camera that sees these points.
    pub(super) fn of(camera: &Camera, points: &[Vec3]) -> Self {
        let (mut matrix, mut count) = ([[0.0; 6]; 6], 0);
        let size = glam::Vec2::new(camera.width as f32, camera.height as f32);
        for &point in points.iter().step_by(points.len().div_ceil(MOST_POINTS).max(1)) {
            let Some((pixel, depth)) = camera.project(point) else { continue };
            if !(pixel.cmpge(glam::Vec2::ZERO).all() && pixel.cmple(size).all()) {
                continue;
            }
            let at: DVec2 = ((pixel - camera.center) / camera.focal).as_dvec2();
            for row in flow(at, camera.focal.as_dvec2(), 1.0 / f64::from(depth)) {
                (0..6).for_each(|i| (0..=i).for_each(|j| matrix[i][j] += row[i] * row[j]));
            }
            count += 1;
        }
        matrix.iter_mut().flatten().for_each(|value| *value /= f64::from(count.max(1)));
        (0..6).for_each(|i| matrix[i][i] *= 1.0 + DAMPING);
        let lower = factored(matrix).filter(|_| count as usize >= LEAST_POINTS);
        let whitening = lower.map_or_else(Vec::new, |lower| (0..6).flat_map(|i| lower[i][..=i].to_vec()).collect());
        Self { whitening, first: [0.0; 6], second: 0.0, steps: 0 }
    }

    /// Whether these are numbers that a run can have stored.
    pub(super) fn is_valid(&self) -> bool {
        let numbers = self.whitening.iter().chain(&self.first).chain([&self.second]);
        matches!(self.whitening.len(), 0 | 21) && numbers.into_iter().all(|value| value.is_finite())
    }

    /// L\[i\]\[j\], j ≤ i.
    fn lower(&self, i: usize, j: usize) -> f64 {
        self.whitening[i * (i + 1) / 2 + j]
    }

    /// The camera after a step of about this length, px.
    pub(super) fn step(&mut self, camera: &Camera, gradient: &[f32; 6], length: f64) -> Camera {
        let mut slope = gradient.map(f64::from);
        if self.whitening.is_empty() || !slope.iter().all(|value| value.is_finite()) {
            return *camera;
        }
        for i in 0..6 {
            slope[i] = (slope[i] - (0..i).map(|k| self.lower(i, k) * slope[k]).sum::<f64>()) / self.lower(i, i);
        }
        let square = slope.iter().map(|value| value * value).sum::<f64>() / 6.0;
        (0..6).for_each(|i| self.first[i] = BETA1 * self.first[i] + (1.0 - BETA1) * slope[i]);
        self.second = BETA2 * self.second + (1.0 - BETA2) * square;
        self.steps += 1;
        // The sums of the weights of both moments. Products have the same bits everywhere, unlike powers.
        let weight = |beta: f64| 1.0 - (0..self.steps).fold(1.0, |power, _| power * beta);
        let scale = (6.0 * self.second / weight(BETA2)).sqrt() * weight(BETA1);
        if !(scale > 0.0) {
            return *camera;
        }
        let mut twist = self.first.map(|value| value / scale);
        // About 1 for gradients that agree with each other, and 0.4 for noise.
        let agreement = twist.iter().map(|value| value * value).sum::<f64>().sqrt();
        twist = twist.map(|value| -length * agreement * value);
        for i in (0..6).rev() {
            twist[i] = (twist[i] - (i + 1..6).map(|k| self.lower(k, i) * twist[k]).sum::<f64>()) / self.lower(i, i);
        }
        let [shift, turn] = [0, 3].map(|k| DVec3::from_slice(&twist[k..k + 3]).as_vec3());
        if shift.is_finite() && turn.is_finite() { camera.moved(shift, turn) } else { *camera }
    }

    /// How far the points move in the image between two cameras, root mean square, px; 0 for a camera that
    /// does not move.
    pub(super) fn distance(&self, from: &Camera, to: &Camera) -> f64 {
        self.pixels(from, to).iter().map(|value| value * value).sum::<f64>().sqrt()
    }

    /// The motion between two cameras in whitened coordinates, whose length is [`Self::distance`].
    pub(super) fn pixels(&self, from: &Camera, to: &Camera) -> [f64; 6] {
        if self.whitening.is_empty() {
            return [0.0; 6];
        }
        let turn = to.rotation.as_dmat3() * from.rotation.as_dmat3().transpose();
        let shift = to.translation.as_dvec3() - turn * from.translation.as_dvec3();
        let turn = DQuat::from_mat3(&turn).normalize().to_scaled_axis();
        let twist = [shift.x, shift.y, shift.z, turn.x, turn.y, turn.z];
        std::array::from_fn(|j| (j..6).map(|i| self.lower(i, j) * twist[i]).sum())
    }
}

/// The gradient by the pose alone.
pub(super) fn by_pose(gradient: &CameraGradient) -> [f32; 6] {
    let [a, b, c, d, e, f, ..] = gradient.to_array();
    [a, b, c, d, e, f]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen() -> (Camera, Vec<Vec3>) {
        let points = (0..40).map(|i| {
            let at = |k: u32| (f64::from(i * 3 + k) * 2.4).sin() as f32;
            Vec3::new(at(0), at(1), 4.0 + at(2))
        });
        (Camera::looking_forward(80, 60, 1.0), points.collect())
    }

    #[test]
    fn a_step_moves_the_points_by_about_its_length_in_any_direction() {
        let (camera, points) = seen();
        for k in 0..6 {
            let mut gradient = [0.0; 6];
            gradient[k] = 1e-3;
            let mut descent = Descent::of(&camera, &points);
            let moved = descent.step(&camera, &gradient, 0.2);
            let squared =
                |&point: &Vec3| camera.project(point).unwrap().0.distance_squared(moved.project(point).unwrap().0);
            let px = (points.iter().map(squared).sum::<f32>() / points.len() as f32).sqrt();
            // Damping shortens steps whose turn and shift nearly cancel.
            assert!((0.05..0.21).contains(&px), "{k}: {px} px");
            assert!((descent.distance(&camera, &moved) - 0.2).abs() < 1e-3);
            // A coordinate of the twist decreases where its derivative is positive.
            let turn = DQuat::from_mat3(&moved.rotation.as_dmat3()).to_scaled_axis().as_vec3();
            assert!([moved.translation, turn].map(|v| v.to_array()).concat()[k] < 0.0);
        }
    }

    #[test]
    fn a_camera_that_sees_too_little_stays() {
        let (camera, points) = seen();
        let mut blind = Descent::of(&camera, &points[..LEAST_POINTS - 1]);
        assert_eq!(blind.step(&camera, &[1.0; 6], 0.2), camera);
        assert!(blind.is_valid() && blind.distance(&camera, &camera.moved(Vec3::X, Vec3::ZERO)) == 0.0);
        let mut descent = Descent::of(&camera, &points);
        assert_eq!(descent.step(&camera, &[f32::NAN; 6], 0.2), camera);
        assert_eq!(descent.step(&camera, &[0.0; 6], 0.2), camera);
    }
}
