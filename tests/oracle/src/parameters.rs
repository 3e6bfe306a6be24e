//! Scenes in `f64`: a row of numbers for each Gaussian, so that finite differences can vary any
//! number.

use gs_core::{Scene, Scene2d, Scene3d};

/// All parameters of one Gaussian, or numbers per parameter: gradients, moments, tolerances.
///
/// In 2D: mean x, mean y (px of the plane), ln-scale 1, ln-scale 2 (ln px), rotation (rad), opacity
/// logit, red, green, blue. In 3D: mean x, y, z (world units), ln-scale 1 to 3, quaternion w, x, y,
/// z, opacity logit, then the SH coefficients, each red, green, blue.
pub type Parameters = Vec<f64>;

/// Names of the entries of a 2D Gaussian's [`Parameters`].
pub const PARAMETER_NAMES: [&str; 9] =
    ["mean x", "mean y", "ln-scale 1", "ln-scale 2", "rotation", "opacity logit", "red", "green", "blue"];

/// Index of a 2D Gaussian's rotation in [`Parameters`].
pub const ROTATION: usize = 4;
/// Index of a 2D Gaussian's opacity logit in [`Parameters`].
pub const OPACITY: usize = 5;
/// Index of a 2D Gaussian's red in [`Parameters`]; green and blue follow.
pub const COLOR: usize = 6;

/// Index of a 3D Gaussian's quaternion in [`Parameters`].
pub const QUATERNION: usize = 6;
/// Index of a 3D Gaussian's opacity logit in [`Parameters`].
pub const OPACITY_3D: usize = 10;
/// Index of a 3D Gaussian's first SH coefficient in [`Parameters`].
pub const SH_3D: usize = 11;

/// SH coefficients per channel in a row of a 3D scene.
pub(crate) fn sh_len(row: &[f64]) -> usize {
    row.len().saturating_sub(SH_3D) / 3
}

/// A scene in `f64`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct OracleScene {
    /// The Gaussians in order. Without stored opacities their logits are +∞.
    pub gaussians: Vec<Parameters>,
}

impl From<&Scene2d> for OracleScene {
    fn from(scene: &Scene2d) -> Self {
        let gaussians = scene.iter().map(|g| {
            let rest = [g.rotation, g.opacity_logit];
            let all = g.mean.to_array().into_iter().chain(g.log_scale.to_array()).chain(rest);
            all.chain(g.color.to_array()).map(f64::from).collect()
        });
        Self { gaussians: gaussians.collect() }
    }
}

impl From<&Scene3d> for OracleScene {
    fn from(scene: &Scene3d) -> Self {
        let gaussians = (0..scene.len()).map(|i| {
            let g = scene.gaussian(i);
            let shape = g.mean.to_array().into_iter().chain(g.log_scale.to_array()).chain(g.rotation);
            let color = g.sh.iter().flat_map(|c| c.to_array());
            shape.chain([g.opacity_logit]).chain(color).map(f64::from).collect()
        });
        Self { gaussians: gaussians.collect() }
    }
}
