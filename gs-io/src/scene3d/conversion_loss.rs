//! Losses of converting a scene from or to a file format.

use std::fmt;

use gs_core::{Scene3d, counted};

use super::trained_with::TrainedWith;
use crate::WorldFrame;

/// Something that was dropped or rounded when a scene was read or written. Its text follows "lost:
/// ".
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum ConversionLoss {
    /// SH above a degree were dropped: colours depend less on the direction.
    Sh {
        /// The degree before.
        from: u8,
        /// The degree that is kept.
        to: u8,
    },
    /// Values were rounded, as the format requires.
    Rounded {
        /// The parameter: "opacities".
        what: &'static str,
        /// The precision: "8 bits".
        to: String,
    },
    /// Values outside of the format's range were clamped.
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
    ZeroScales {
        /// Number of Gaussians with such a scale.
        gaussians: usize,
    },
    /// Infinite logits, which are opacities of exactly 1 and 0, were made finite. Pictures do not
    /// change.
    InfiniteLogits {
        /// Number of Gaussians with such a logit.
        gaussians: usize,
    },
    /// The file cannot store how the scene was trained, so readers may render it differently.
    TrainedWith(TrainedWith),
    /// The file cannot store the frame of the scene, so its place and size in the world are lost.
    Frame(WorldFrame),
    /// Means were rounded from 64 to 32 bits.
    RoundedMeans {
        /// The largest change of a mean, relative to the smallest scale of its Gaussian.
        largest: f64,
        /// Number of Gaussians that move by more than a tenth of their smallest scale.
        visible: usize,
    },
    /// Quaternions were normalised. Rotations do not change.
    QuaternionLengths,
    /// Colours were converted from linear light: the constant part exactly, the directional part to
    /// first order. Blending is different.
    LinearLight,
    /// Scales were read as logarithms, as in drafts of the format, because some are negative.
    DraftScales,
    /// A node scales its Gaussians non-uniformly. Shapes are transformed exactly; the directions of
    /// colours follow its rotation only.
    Stretched,
}

impl ConversionLoss {
    /// What finite logits in place of infinite ones change.
    pub(super) fn of_infinite_logits(scene: &Scene3d) -> Option<Self> {
        let gaussians = scene.opacity_logits.iter().filter(|logit| logit.is_infinite()).count();
        (gaussians > 0).then_some(Self::InfiniteLogits { gaussians })
    }
}

impl fmt::Display for ConversionLoss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Sh { from, to } => {
                let coefficients = |degree: &u8| 3 * (usize::from(*degree) + 1).pow(2);
                let dropped = coefficients(from) - coefficients(to);
                write!(f, "SH above degree {to}: {dropped} coefficients of each Gaussian")
            }
            Self::Rounded { what, to } => write!(f, "{what} are rounded to {to}"),
            Self::Clamped { what, values, low, high } => {
                write!(f, "{what} outside {low}..{high} are clamped: {}", counted(*values, "value"))
            }
            Self::ZeroScales { gaussians } => {
                write!(f, "scales of 0 are raised to the smallest number above it: {}", counted(*gaussians, "Gaussian"))
            }
            Self::InfiniteLogits { gaussians } => {
                write!(
                    f,
                    "infinite opacity logits are made finite, which draws the same: {}",
                    counted(*gaussians, "Gaussian")
                )
            }
            Self::TrainedWith(TrainedWith { antialias, order, frame: _ }) => {
                let antialias = antialias.map(|antialias| format!("antialias {}", antialias.name()));
                let order = order.map(|order| format!("order {}", order.name()));
                let trained_with = antialias.into_iter().chain(order).collect::<Vec<_>>().join(", ");
                write!(f, "how the scene was trained, with {trained_with}: viewers must be set accordingly")
            }
            Self::Frame(frame) => write!(f, "where the scene is in the world: {frame}"),
            Self::RoundedMeans { largest, visible } => {
                write!(f, "means are rounded to 32 bits: by {:.1e} of the smallest scale at most", largest)?;
                match visible {
                    0 => Ok(()),
                    _ => write!(f, ", and by more than a tenth in {}", counted(*visible, "Gaussian")),
                }
            }
            Self::QuaternionLengths => f.write_str("the lengths of quaternions, which mean nothing"),
            Self::LinearLight => f.write_str("colours in linear light are converted to sRGB to first order"),
            Self::DraftScales => f.write_str("scales below 0: taken as logarithms, as drafts of the format had them"),
            Self::Stretched => f.write_str("unequal scales of a node: colours' directions follow its rotation only"),
        }
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

    pub(crate) fn apply(&mut self, value: f32) -> f32 {
        if value < self.low - self.tolerance || value > self.high + self.tolerance {
            self.values += 1;
        }
        value.clamp(self.low, self.high)
    }

    pub(crate) fn loss(&self) -> Option<ConversionLoss> {
        let Self { what, low, high, values, .. } = *self;
        (values > 0).then_some(ConversionLoss::Clamped { what, values, low, high })
    }
}
