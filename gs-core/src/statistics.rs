//! What training collects per Gaussian, for density policies to look at, and what rendering left out.

use serde::{Deserialize, Serialize};

/// Per-Gaussian statistics since the last edit, `[N]` each, in the order of the scene.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct DensityStatistics {
    /// Σ over steps of what [`Statistics`](crate::effects::Statistics) asks for, one number per step: the positional gradient
    /// ‖(∂L/∂u · W/2, ∂L/∂v · H/2)‖ in normalised device units (*source:* 3DGS), its absolute variant, or the pixel error in px. Zeros
    /// where nothing was asked for. There is one sum: two statistics are not to be mixed without an edit between them.
    pub gradient_sum: Vec<f32>,
    /// Steps in which the Gaussian was drawn.
    pub visible: Vec<u32>,
}

impl DensityStatistics {
    /// Statistics of `len` Gaussians that were never drawn.
    pub fn zeros(len: usize) -> Self {
        Self { gradient_sum: vec![0.0; len], visible: vec![0; len] }
    }

    /// The mean positional gradient (or whichever statistic was collected) of Gaussian `index` over the steps in which it was drawn, 0
    /// where there were none.
    pub fn mean_gradient(&self, index: usize) -> f32 {
        self.gradient_sum[index] / self.visible[index].max(1) as f32
    }
}

/// Gaussians that a frame left out, by cause.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Culled {
    /// A parameter, or the covariance made of them, is NaN or infinite.
    pub not_finite: u32,
    /// det Σ′ below [`MIN_DETERMINANT_PX4`](crate::constants::MIN_DETERMINANT_PX4), or a quaternion without direction.
    pub degenerate: u32,
    /// Opacity below the α cut.
    pub transparent: u32,
    /// Touches no pixel of the view above the cut.
    pub outside: u32,
}
