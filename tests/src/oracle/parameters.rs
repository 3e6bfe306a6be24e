//! A planar scene in `f64`: nine numbers a Gaussian, so that finite differences can nudge any of them.

use gs_core::PlanarScene;

/// All parameters of one Gaussian, in this order: mean x, mean y (px of the plane), ln-scale 1, ln-scale 2 (ln px), rotation (rad),
/// opacity logit, red, green, blue. Also used for whatever exists once per parameter: gradients, moments, tolerances.
pub type Parameters = [f64; 9];

/// What each entry of [`Parameters`] is.
pub const PARAMETER_NAMES: [&str; 9] =
    ["mean x", "mean y", "ln-scale 1", "ln-scale 2", "rotation", "opacity logit", "red", "green", "blue"];

/// Index of the rotation in [`Parameters`].
pub const ROTATION: usize = 4;
/// Index of the opacity logit in [`Parameters`].
pub const OPACITY: usize = 5;
/// Index of red in [`Parameters`]; green and blue follow.
pub const COLOR: usize = 6;

/// A planar scene as the oracle sees it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct OracleScene {
    /// The Gaussians in order; without stored opacities their logits are +∞.
    pub gaussians: Vec<Parameters>,
}

impl From<&PlanarScene> for OracleScene {
    fn from(scene: &PlanarScene) -> Self {
        let gaussians = scene
            .iter()
            .map(|g| {
                let all = [
                    g.mean.x,
                    g.mean.y,
                    g.log_scale.x,
                    g.log_scale.y,
                    g.rotation,
                    g.opacity_logit,
                    g.color.x,
                    g.color.y,
                    g.color.z,
                ];
                all.map(f64::from)
            })
            .collect();
        Self { gaussians }
    }
}

/// The gradients that a backend downloaded (a scene of derivatives) as rows; a missing opacity gradient is 0.
pub fn rows_of_gradients(gradients: &PlanarScene) -> Vec<Parameters> {
    let mut rows = OracleScene::from(gradients).gaussians;
    if !gradients.has_opacity() {
        rows.iter_mut().for_each(|row| row[OPACITY] = 0.0);
    }
    rows
}
