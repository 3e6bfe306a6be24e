//! The names of the stages, for profiles.

/// The stages of a training step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Finds the order in which tiles see the Gaussians.
    Sort,
    /// Computes what pixels need of each Gaussian.
    Project,
    /// Lists the Gaussians that touch each tile.
    Bin,
    /// Draws the image.
    Blend,
    /// Computes the loss and its gradient with respect to the image.
    Loss,
    /// Computes the gradient of each tile entry.
    BlendBwd,
    /// `Blend`, `Loss` and `BlendBwd` in one pass, if a training step fuses them.
    Fused,
    /// Computes the gradient of each Gaussian.
    ProjectBwd,
    /// Moves the parameters.
    Adam,
    /// `ProjectBwd` and `Adam` in one pass, if a training step fuses them.
    Update,
}

impl Stage {
    pub(crate) const FROM_BIN: [Self; 5] = [Self::Bin, Self::Blend, Self::Loss, Self::BlendBwd, Self::Fused];

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Sort => "sort",
            Self::Project => "project",
            Self::Bin => "bin",
            Self::Blend => "blend",
            Self::Loss => "loss",
            Self::BlendBwd => "blend_bwd",
            Self::Fused => "fused",
            Self::ProjectBwd => "project_bwd",
            Self::Adam => "adam",
            Self::Update => "update",
        }
    }

    pub(crate) fn replaces(self) -> &'static [&'static str] {
        match self {
            Self::Fused => &["blend", "loss", "blend_bwd"],
            Self::Update => &["project_bwd", "adam"],
            _ => &[],
        }
    }

    pub(crate) fn visits_pairs(self) -> bool {
        matches!(self, Self::Blend | Self::BlendBwd | Self::Fused)
    }
}
