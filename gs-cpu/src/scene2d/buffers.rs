//! The buffers that only 2D scenes need.

use glam::Vec2;
use gs_core::{Canvas, math::whitened::WhitenedGradient};

use crate::{splat::Share, workspace::Workspace};

/// The buffers that only 2D scenes need.
#[derive(Debug)]
pub struct Buffers2d {
    pub(crate) canvas: Canvas,
    /// Place → Gaussian: the order in which tiles see the Gaussians.
    pub(crate) order: Vec<u32>,
    /// Gaussian → rank.
    pub(crate) rank_of: Vec<u32>,
    /// The next rank in each image row, during the sort.
    pub(crate) next_ranks: Vec<u32>,
    /// Every Gaussian's gradient, by rank.
    pub(crate) gradients: Vec<Gradient>,
}

impl Default for Buffers2d {
    fn default() -> Self {
        let (order, rank_of, next_ranks, gradients) = Default::default();
        Self { canvas: Canvas::new(1, 1), order, rank_of, next_ranks, gradients }
    }
}

impl Workspace<Buffers2d> {
    /// The gradient of Gaussian `index`.
    pub(crate) fn gradient_of(&self, index: usize) -> &Gradient {
        &self.buffers.gradients[self.buffers.rank_of[index] as usize]
    }
}

/// ∂L/∂(one Gaussian's parameters), in its whitened coordinates.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Gradient {
    pub(crate) color: [f32; 3],
    /// v_ξ.
    pub(crate) xi: Vec2,
    /// v_η: (η₀₀, η₀₁ = η₁₀ each, η₁₁).
    pub(crate) eta: [f32; 3],
    /// ∂L/∂(opacity logit).
    pub(crate) opacity_logit: f32,
    /// Contribution of this step to the statistic; 0 without one.
    pub(crate) share: Share,
    /// Whether any tile lists the Gaussian.
    pub(crate) visible: bool,
}

impl Gradient {
    pub(crate) fn whitened(&self) -> WhitenedGradient {
        WhitenedGradient { xi: self.xi, eta: self.eta }
    }
}
