//! Camera poses that are wrong by a given amount.

use glam::Vec3;
use gs_density::Rng;
use gs_train::train::{PosedView, Views, extent_of};
use rand::SeedableRng as _;
use rand_distr::{Distribution, UnitSphere};
use serde::{Deserialize, Serialize};

/// By how much the poses of all views are wrong, each in a random direction of its own, which follows from the seed
/// of the run. Points of a reconstruction stay where they are.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub struct PoseError {
    /// Angle by which each camera is turned, degrees.
    pub degrees: f32,
    /// Distance by which each camera is moved, percent of the extent of the training cameras.
    pub percent: f32,
}

impl PoseError {
    /// Checks that both are finite and not negative; an error is why not.
    pub(crate) fn validate(&self) -> Result<(), String> {
        let is_right = |value: f32| value.is_finite() && value >= 0.0;
        match is_right(self.degrees) && is_right(self.percent) {
            true => Ok(()),
            false => Err("degrees and percent must be finite and not negative".to_owned()),
        }
    }

    /// The views with wrong poses.
    pub(crate) fn applied(&self, mut views: Views, seed: u32) -> Views {
        let extent = extent_of(views.train_cameras(), &[]);
        let mut random = Rng::seed_from_u64(seed.into());
        let mut direction = || Vec3::from_array(UnitSphere.sample(&mut random));
        let mut disturb = |view: &mut PosedView| {
            let (turn, shift) = (direction() * self.degrees.to_radians(), direction() * self.percent / 100.0 * extent);
            // The camera turns around its own position.
            let position = view.camera.position() + shift;
            view.camera.rotation = view.camera.moved(Vec3::ZERO, turn).rotation;
            view.camera.translation = -(view.camera.rotation * position);
        };
        views.train.iter_mut().chain(&mut views.test).for_each(&mut disturb);
        views
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use gs_core::{Camera, Image};
    use gs_io::dataset::PosedImage;

    use super::*;

    #[test]
    fn cameras_are_off_by_the_given_amounts_in_directions_of_their_own() {
        let lens = Camera::looking_forward(64, 48, 1.0);
        let view = |i: u32| PosedView {
            name: i.to_string(),
            camera: lens.looking_at(Vec3::new(i as f32, 1.0, -4.0), Vec3::ZERO, Vec3::Y).unwrap(),
            source: Arc::new(PosedImage { image: Image::filled(64, 48, [0.5; 3]).unwrap(), alpha: None, mask: None }),
        };
        let views = Views::new((0..9).map(view).collect(), vec![view(9)]);
        let error = PoseError { degrees: 0.5, percent: 2.0 };
        let cameras =
            |views: &Views| -> Vec<Camera> { views.train.iter().chain(&views.test).map(|v| v.camera).collect() };
        let (before, after) = (cameras(&views), cameras(&error.applied(views.clone(), 3)));
        let shifts: Vec<Vec3> = before.iter().zip(&after).map(|(a, b)| b.position() - a.position()).collect();
        // 1.1 times the four units from the middle of the training cameras.
        assert!(shifts.iter().all(|shift| (shift.length() - 0.088).abs() < 1e-4), "{shifts:?}");
        assert!(shifts.windows(2).all(|pair| pair[0].angle_between(pair[1]) > 1e-2), "{shifts:?}");
        for (a, b) in before.iter().zip(&after) {
            let turn = glam::Quat::from_mat3(&(b.rotation * a.rotation.transpose()));
            assert!((turn.to_axis_angle().1.to_degrees() - 0.5).abs() < 1e-2);
        }
        assert_eq!(after, cameras(&error.applied(views.clone(), 3)));
        assert_ne!(after, cameras(&error.applied(views, 4)));
        assert!(PoseError { degrees: -1.0, percent: 0.0 }.validate().is_err());
        assert!(PoseError { degrees: 0.0, percent: f32::NAN }.validate().is_err());
    }
}
