//! The range of coordinates that a format holds.

use std::path::Path;

use gs_core::{Scene3d, counted};

use super::{Format3d, WriteOptions3d};
use crate::error::Error;

impl Format3d {
    /// Indices of the Gaussians whose means a file of this format cannot hold, ascending: beyond ±8,388,607
    /// units in SPZ, or infinite in 32 bits once they are in the coordinates of the file.
    pub fn cannot_hold(self, scene: &Scene3d, options: &WriteOptions3d) -> Vec<usize> {
        let unit = options.world().filter(|_| !self.row().stores_frame).map_or(1.0, |frame| frame.unit);
        let is_beyond = |&i: &usize| (distance(scene, i) * unit).round() > self.row().largest;
        (0..scene.means.len()).filter(is_beyond).collect()
    }
}

/// Largest coordinate of a Gaussian's mean.
fn distance(scene: &Scene3d, index: usize) -> f64 {
    scene.means[index].abs().max_element().into()
}

/// The Gaussian with the largest coordinate, and that coordinate, for a scene with finite means.
pub(super) fn farthest(scene: &Scene3d) -> Option<(usize, f64)> {
    (0..scene.means.len()).map(|i| (i, distance(scene, i))).max_by(|a, b| a.1.total_cmp(&b.1))
}

/// Fails for a scene with means that the format cannot hold.
pub(super) fn check(path: &Path, format: Format3d, scene: &Scene3d, options: &WriteOptions3d) -> Result<(), Error> {
    let beyond = format.cannot_hold(scene, options);
    let Some(&first) = beyond.first() else { return Ok(()) };
    let others = beyond.len() - 1;
    let others = if others > 0 { format!(" and {}", counted(others, "other")) } else { String::new() };
    let (place, largest) = (distance(scene, first) as f32, format.row().largest);
    let what = format!("a coordinate of ±{place:e} (Gaussian {first}{others}), beyond ±{largest} units,");
    let hint = "leave such Gaussians out (gs convert --drop-broken), scale the scene, or write a PLY";
    Err(Error::unsupported(path, what, hint))
}
