//! What a format, or the way into one, does not keep.

use std::fmt;

use gs_core::counted;

use super::trained_with::TrainedWith;

/// Something that was dropped or rounded when a scene was read or written. Its text completes "lost: …".
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum ConversionLoss {
    /// Spherical harmonics above a degree: colour no longer changes with the direction as it did.
    Sh {
        /// The degree that there was.
        from: u8,
        /// The degree that is left.
        to: u8,
    },
    /// Values were rounded, as the format prescribes.
    Rounded {
        /// The parameter: "opacities".
        what: &'static str,
        /// To what: "8 bits".
        to: String,
    },
    /// Some values lay outside of what the format can hold, and were moved to its border.
    Clamped {
        /// The parameter: "log-scales".
        what: &'static str,
        /// How many values, not Gaussians.
        values: usize,
        /// The smallest that can be held.
        low: f32,
        /// The largest.
        high: f32,
    },
    /// Scales of 0, of which there is no logarithm, were raised to the smallest normal number; what is drawn is the same.
    ZeroScales {
        /// How many Gaussians have such a scale.
        gaussians: usize,
    },
    /// Logits of ±∞, opacities of exactly 1 and 0, were made finite; what is drawn is the same.
    InfiniteLogits {
        /// How many Gaussians have one.
        gaussians: usize,
    },
    /// How the scene was trained, of which the file has no room to tell: readers will show it otherwise.
    TrainedWith(TrainedWith),
    /// Quaternions were brought to unit length; the rotations that they stand for are the same.
    QuaternionLengths,
    /// Colours were converted from linear light: the constant part exactly, what depends on the direction to first order, and
    /// blending is not the same.
    LinearLight,
    /// Scales were taken as logarithms, as drafts of the format had them, because some are negative.
    DraftScales,
    /// A node stretches its Gaussians unequally: shapes follow exactly, the directions of their colours only its rotation.
    Stretched,
}

impl fmt::Display for ConversionLoss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Sh { from, to } => {
                let coefficients = |degree: &u8| 3 * (usize::from(*degree) + 1).pow(2);
                let dropped = coefficients(from) - coefficients(to);
                write!(f, "spherical harmonics above degree {to}: {dropped} coefficients of each Gaussian")
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
            Self::TrainedWith(TrainedWith { antialias, order }) => {
                let antialias = antialias.map(|antialias| format!("antialias {}", antialias.name()));
                let order = order.map(|order| format!("order {}", order.name()));
                let trained_with = antialias.into_iter().chain(order).collect::<Vec<_>>().join(", ");
                write!(f, "how the scene was trained, with {trained_with}: viewers must be told")
            }
            Self::QuaternionLengths => f.write_str("the lengths of quaternions, which mean nothing"),
            Self::LinearLight => f.write_str("colours in linear light are converted to sRGB to first order"),
            Self::DraftScales => f.write_str("scales below 0: taken as logarithms, as drafts of the format had them"),
            Self::Stretched => f.write_str("unequal scales of a node: colours' directions follow its rotation only"),
        }
    }
}

/// Clamps a value and counts where that moved it by more than rounding would.
#[derive(Debug)]
pub(crate) struct Clamp {
    what: &'static str,
    low: f32,
    high: f32,
    tolerance: f32,
    values: usize,
}

impl Clamp {
    /// To `low..=high`; what lies no more than `tolerance` outside is not counted.
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
