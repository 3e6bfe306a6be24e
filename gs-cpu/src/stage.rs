//! The names of the stages, for profiles.

gs_core::choices! {
    /// The stages of a training step.
    pub enum Stage {
        /// Finds the order in which tiles see the Gaussians.
        Sort = "sort",
        /// Computes what pixels need of each Gaussian.
        Project = "project",
        /// Lists the Gaussians that touch each tile.
        Bin = "bin",
        /// Draws the image.
        Blend = "blend",
        /// Computes the loss and its gradient with respect to the image.
        Loss = "loss",
        /// Computes the gradient of each tile entry.
        BlendBwd = "blend_bwd",
        /// `Blend`, `Loss` and `BlendBwd` in one pass, if a training step fuses them.
        Fused = "fused",
        /// Computes the gradient of each Gaussian.
        ProjectBwd = "project_bwd",
        /// Moves the parameters.
        Adam = "adam",
        /// `ProjectBwd` and `Adam` in one pass, if a training step fuses them.
        Update = "update",
    }
}

impl Stage {
    pub(crate) const FROM_BIN: [Self; 5] = [Self::Bin, Self::Blend, Self::Loss, Self::BlendBwd, Self::Fused];

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
