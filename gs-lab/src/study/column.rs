//! The numbers of a run that claims are about.

use std::fmt;

use serde::{Deserialize, Serialize};

/// A number of a run that did all its steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Column {
    /// Gaussians.
    Gaussians,
    /// PSNR, dB.
    Psnr,
    /// SSIM, 0 to 1.
    Ssim,
    /// The loss.
    Loss,
    /// The natural logarithm of the loss.
    LnLoss,
    /// 1 for a run that failed, 0 for one that finished.
    Failed,
    /// The step after which the budget is reached; the last step if it never is.
    StepAtBudget,
    /// The last step after which there are more Gaussians; 0 without growth.
    LastGrowth,
    /// By how much ln loss falls faster, per 100 steps, after a round of growth than before it: the
    /// mean over rounds of the slope over half the distance of two rounds after it, less that before.
    SlopeChange,
    /// Of a choice: the chosen arm's place in its list, counted from 1; 0 if no arm meets the bound.
    Place,
    /// Of the start: the share of Gaussians whose positional gradient under L1 the image changes,
    /// compared with an image of the background only.
    StartPulled,
    /// Of the start: the largest such change, in normalised device units.
    StartPull,
    /// Of the start: the largest such change under the run's own loss.
    StartPullOfLoss,
    /// Of the start: the largest positional gradient under L1, in normalised device units.
    StartGradient,
    /// Gaussians on the paper's square.
    SquareCount,
    /// Median √(σ₁σ₂) of those, px.
    SquareSize,
    /// Gaussians on the paper's disc.
    DiscCount,
    /// Median √(σ₁σ₂) of those, px.
    DiscSize,
    /// Gaussians per 100 px² within 4 px of the square's edge.
    SquareEdgeDensity,
    /// Median ratio of the longer σ to the shorter of those.
    SquareEdgeStretch,
    /// Median √(σ₁σ₂) of those, px.
    SquareEdgeSize,
    /// Gaussians per 100 px² within 4 px of the disc's edge.
    DiscEdgeDensity,
    /// Median ratio of the longer σ to the shorter of those.
    DiscEdgeStretch,
    /// Median √(σ₁σ₂) of those, px.
    DiscEdgeSize,
}

gs_core::choices! {
    /// What is measured of every run of a study besides the usual, and stored with it.
    pub(crate) enum Measure {
        /// The gradients before the first step.
        Start = "start",
        /// Number and shape of the Gaussians on the paper's disc and square, and at their edges.
        Shapes = "shapes",
    }
}

impl Column {
    /// Whether it is known at every step.
    pub(crate) const fn has_course(self) -> bool {
        matches!(self, Self::Gaussians | Self::Psnr | Self::Loss | Self::LnLoss)
    }

    /// What a study must measure to have it; `None` for what every run has.
    pub(crate) fn measure(self) -> Option<Measure> {
        match self {
            _ if self < Self::StartPulled => None,
            _ if self < Self::SquareCount => Some(Measure::Start),
            _ => Some(Measure::Shapes),
        }
    }
}

impl fmt::Display for Column {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}
