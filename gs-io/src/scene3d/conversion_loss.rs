//! Losses of converting a scene from or to a file format.

use gs_core::{Scene3d, counted};
use thiserror::Error;

use super::{trained_with::TrainedWith, values::rest_of_degree};
use crate::WorldFrame;

/// Something that was dropped or rounded when a scene was read or written. Its text follows "lost:
/// ".
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum ConversionLoss {
    /// SH above a degree were dropped: colours depend less on the direction.
    #[error("SH above degree {to}: {} coefficients of each Gaussian", dropped(*from, *to))]
    Sh {
        /// The degree before.
        from: u8,
        /// The degree that is kept.
        to: u8,
    },
    /// Values were rounded, as the format requires.
    #[error("{what} are rounded to {to}")]
    Rounded {
        /// The parameter: "opacities".
        what: &'static str,
        /// The precision: "8 bits".
        to: String,
    },
    /// Values outside of the format's range were clamped.
    #[error("{what} outside {low}..{high} are clamped: {}", counted(*values, "value"))]
    Clamped {
        /// The parameter: "log-scales".
        what: &'static str,
        /// Number of values, not of Gaussians.
        values: usize,
        /// The smallest possible value.
        low: f32,
        /// The largest possible value.
        high: f32,
    },
    /// Scales of 0, which have no logarithm, were raised to the smallest normal number. Pictures do
    /// not change.
    #[error("scales of 0 are raised to the smallest number above it: {}", counted(*gaussians, "Gaussian"))]
    ZeroScales {
        /// Number of Gaussians with such a scale.
        gaussians: usize,
    },
    /// Infinite logits, which are opacities of exactly 1 and 0, were made finite. Pictures do not
    /// change.
    #[error("infinite opacity logits are made finite, which draws the same: {}", counted(*gaussians, "Gaussian"))]
    InfiniteLogits {
        /// Number of Gaussians with such a logit.
        gaussians: usize,
    },
    /// The file cannot store how the scene was trained, so readers may render it differently.
    #[error("how the scene was trained, with {}: viewers must be set accordingly", .0.in_words())]
    TrainedWith(TrainedWith),
    /// The file cannot store the frame of the scene, so its place and size in the world are lost.
    #[error("where the scene is in the world: {0}")]
    Frame(WorldFrame),
    /// Means were rounded from 64 to 32 bits.
    #[error("means are rounded to 32 bits: by {largest:.1e} of the smallest scale at most{}", visible_moves(*visible))]
    RoundedMeans {
        /// The largest change of a mean, relative to the smallest scale of its Gaussian.
        largest: f64,
        /// Number of Gaussians that move by more than a tenth of their smallest scale.
        visible: usize,
    },
    /// Quaternions were normalised. Rotations do not change.
    #[error("the lengths of quaternions, which mean nothing")]
    QuaternionLengths,
    /// Colours were converted from linear light: the constant part exactly, the directional part to
    /// first order. Blending is different.
    #[error("colours in linear light are converted to sRGB to first order")]
    LinearLight,
    /// Scales were read as logarithms, as in drafts of the format, because some are negative.
    #[error("scales below 0: taken as logarithms, as drafts of the format had them")]
    DraftScales,
    /// A node scales its Gaussians non-uniformly. Shapes are transformed exactly; the directions of
    /// colours follow its rotation only.
    #[error("unequal scales of a node: colours' directions follow its rotation only")]
    Stretched,
}

impl ConversionLoss {
    /// Adds what a further part of a scene has lost, so that each kind of loss stands there once.
    pub fn merge(all: &mut Vec<Self>, more: impl IntoIterator<Item = Self>) {
        for loss in more {
            let same = |known: &&mut Self| match (known, &loss) {
                (Self::Rounded { what, .. }, Self::Rounded { what: other, .. })
                | (Self::Clamped { what, .. }, Self::Clamped { what: other, .. }) => *what == *other,
                (Self::ZeroScales { .. }, Self::ZeroScales { .. }) => true,
                (Self::InfiniteLogits { .. }, Self::InfiniteLogits { .. }) => true,
                (known, other) => **known == *other,
            };
            match (all.iter_mut().find(same), loss) {
                (None, loss) => all.push(loss),
                (Some(Self::Clamped { values, .. }), Self::Clamped { values: more, .. }) => *values += more,
                (Some(Self::ZeroScales { gaussians }), Self::ZeroScales { gaussians: more })
                | (Some(Self::InfiniteLogits { gaussians }), Self::InfiniteLogits { gaussians: more }) => {
                    *gaussians += more
                }
                _ => {}
            }
        }
    }

    /// What lowering an SH degree drops.
    pub(super) fn of_degree(from: u8, to: u8) -> Option<Self> {
        (to < from).then_some(Self::Sh { from, to })
    }

    /// What finite logits in place of infinite ones change.
    pub(super) fn of_infinite_logits(scene: &Scene3d) -> Option<Self> {
        let gaussians = scene.opacity_logits.iter().filter(|logit| logit.is_infinite()).count();
        (gaussians > 0).then_some(Self::InfiniteLogits { gaussians })
    }
}

/// How many coefficients a Gaussian loses.
fn dropped(from: u8, to: u8) -> usize {
    rest_of_degree(from) - rest_of_degree(to)
}

fn visible_moves(count: usize) -> String {
    match count {
        0 => String::new(),
        _ => format!(", and by more than a tenth in {}", counted(count, "Gaussian")),
    }
}

/// Clamps values and counts those that change by more than rounding.
#[derive(Debug)]
pub(crate) struct Clamp {
    what: &'static str,
    low: f32,
    high: f32,
    tolerance: f32,
    values: usize,
}

impl Clamp {
    /// Clamps to `low..=high`; values up to `tolerance` outside are not counted.
    pub(crate) fn new(what: &'static str, low: f32, high: f32, tolerance: f32) -> Self {
        Self { what, low, high, tolerance, values: 0 }
    }

    #[inline]
    pub(crate) fn apply(&mut self, value: f32) -> f32 {
        if value < self.low - self.tolerance || value > self.high + self.tolerance {
            self.values += 1;
        }
        value.clamp(self.low, self.high)
    }

    /// The smallest and the largest value that stay as they are.
    #[cfg(feature = "write")]
    pub(crate) fn range(&self) -> [f32; 2] {
        [self.low, self.high]
    }

    pub(crate) fn loss(&self) -> Option<ConversionLoss> {
        let Self { what, low, high, values, .. } = *self;
        (values > 0).then_some(ConversionLoss::Clamped { what, values, low, high })
    }
}
