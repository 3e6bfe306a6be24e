//! What can be wrong with a Gaussian, each with its meaning in words and what a repair does about it.

use std::fmt;

use serde::Serialize;

/// A Gaussian whose axes differ more than this is a needle: in 2D the longer against the shorter, in 3D the longest against
/// the middle one (flat Gaussians are what surfaces are made of). Unit: none.
///
/// This project's choice: a training by 3DGS's own code has none above 54 among 9,080; a scene that another tool has made has 14,456 among 124,495, as
/// thin as a millionth of their length.
pub const NEEDLE_ASPECT: f32 = 1000.0;

/// A Gaussian is an outlier if it is so many times as far from the scene's middle as half of the Gaussians are. Unit: none.
///
/// This project's choice: what is trained from photographs reaches about as far as the sky is put, tens of times; a mean that has run away is
/// further off.
pub const OUTLIER_DISTANCES: f32 = 1000.0;

/// A finite opacity logit beyond this, either way, is out of range. Unit: none.
///
/// exp of more overflows `f32`, so the opacity is exactly 0 or 1 and no gradient can move it. ±∞ says the same and is legitimate.
pub const OUT_OF_RANGE_LOGIT: f32 = 88.0;

/// A colour, or an SH coefficient, beyond this, either way, is extreme. Unit: that of colours, whose white is 1.
pub const EXTREME_COLOR: f32 = 1000.0;

/// What a repair makes of a ln-scale of −∞: that of the smallest normal `f32`, as readers of scales do. Unit: ln(px or world units).
pub const SMALLEST_LOG_SCALE: f32 = -87.336_55;

/// What may be wrong with a Gaussian.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Finding {
    /// Its mean is NaN or infinite.
    MeanNotFinite,
    /// A ln-scale is NaN or +∞, or so large that the scale is infinite in `f32`.
    ScaleNotFinite,
    /// Its rotation is NaN or infinite.
    RotationNotFinite,
    /// Its opacity logit is NaN.
    OpacityNotANumber,
    /// Its colour, or an SH coefficient, is NaN or infinite.
    ColorNotFinite,
    /// Its quaternion is shorter than
    /// [`MIN_QUATERNION_NORM2`](crate::constants::MIN_QUATERNION_NORM2) allows: it has no direction. 3D scenes.
    NoRotation,
    /// A scale is exactly 0: its ln is −∞.
    ZeroScale,
    /// Too small to be resolved: its longest axis is shorter than the distance between neighbouring `f32` at its mean, or, in 2D, det Σ is
    /// below [`MIN_DETERMINANT_PX4`](crate::constants::MIN_DETERMINANT_PX4). It is drawn only if an [`Antialias`](crate::effects::Antialias)
    /// widens it, or magnified.
    Vanishing,
    /// So large that its variance is infinite in `f32`, though the scale is not: it is drawn only if it is seen from so far that it is smaller
    /// in pixels.
    Enormous,
    /// Its axes differ by more than [`NEEDLE_ASPECT`].
    Needle,
    /// Mean, scales and rotation are those of an earlier Gaussian, bit for bit (0 and −0 are the same); opacity and colour may differ.
    Duplicate,
    /// Its opacity is below [`ALPHA_CUT`](crate::constants::ALPHA_CUT): where Gaussians are blended over each other, it is never seen.
    Transparent,
    /// Its opacity logit is finite, but beyond [`OUT_OF_RANGE_LOGIT`].
    OpacityOutOfRange,
    /// A colour is beyond [`EXTREME_COLOR`].
    ExtremeColor,
    /// It is further than [`OUTLIER_DISTANCES`] from the others.
    Outlier,
}

/// What a repair does about a finding, the mildest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Remedy {
    /// Nothing: the Gaussian is drawn as it stands, and without it the picture would be another.
    Leave,
    /// The scale is raised to [`SMALLEST_LOG_SCALE`], which draws the same and can be stored.
    Widen,
    /// The Gaussian goes. It draws nothing.
    Remove,
}

impl Finding {
    /// What a repair does about it.
    pub fn remedy(self) -> Remedy {
        match self {
            Self::MeanNotFinite
            | Self::ScaleNotFinite
            | Self::RotationNotFinite
            | Self::OpacityNotANumber
            | Self::ColorNotFinite
            | Self::NoRotation => Remedy::Remove,
            Self::ZeroScale => Remedy::Widen,
            Self::Vanishing
            | Self::Enormous
            | Self::Needle
            | Self::Duplicate
            | Self::Transparent
            | Self::OpacityOutOfRange
            | Self::ExtremeColor
            | Self::Outlier => Remedy::Leave,
        }
    }

    /// Whether a Gaussian of which this is found is broken.
    pub fn is_broken(self) -> bool {
        self.remedy() != Remedy::Leave
    }
}

/// In words that complete "a Gaussian whose …".
impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::MeanNotFinite => f.write_str("mean is NaN or infinite"),
            Self::ScaleNotFinite => f.write_str("scale is NaN or infinite"),
            Self::RotationNotFinite => f.write_str("rotation is NaN or infinite"),
            Self::OpacityNotANumber => f.write_str("opacity is NaN"),
            Self::ColorNotFinite => f.write_str("colour is NaN or infinite"),
            Self::NoRotation => f.write_str("quaternion is 0"),
            Self::ZeroScale => f.write_str("scale is 0"),
            Self::Vanishing => f.write_str("size is too small to be resolved; drawn only if widened"),
            Self::Enormous => f.write_str("size is too large for its square; drawn only from afar"),
            Self::Needle => write!(f, "shape is a needle, more than {NEEDLE_ASPECT} times as long as wide"),
            Self::Duplicate => f.write_str("place and shape are those of an earlier one"),
            Self::Transparent => f.write_str("opacity is below 1/255, never seen"),
            Self::OpacityOutOfRange => {
                write!(f, "opacity logit is finite but beyond ±{OUT_OF_RANGE_LOGIT}")
            }
            Self::ExtremeColor => write!(f, "colour is beyond ±{EXTREME_COLOR}"),
            Self::Outlier => {
                write!(f, "place is more than {OUTLIER_DISTANCES} times as far off as half of them")
            }
        }
    }
}
