//! Scenes of fewer Gaussians, for trainings that take a small part of a run's time.

use gs_core::{Scene as _, Scene3d};

/// About `most` Gaussians of a scene, evenly drawn, with this SH degree at most, and larger where that leaves gaps. Also
/// returns of how many of the scene's each of them is one.
pub(in crate::train) fn thinned(scene: &Scene3d, most: usize, sh_degree: u8) -> (Scene3d, usize) {
    let every = scene.len().div_ceil(most).max(1);
    let degree = sh_degree.min(scene.sh_degree);
    let mut thin: Scene3d =
        (0..scene.len()).step_by(every).map(|index| scene.gaussian(index).with_degree(degree)).collect();
    thin.log_scales.iter_mut().for_each(|scale| *scale += (every as f32).ln() / 3.0);
    (thin, every)
}
