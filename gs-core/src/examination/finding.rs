//! The findings of an examination, each with its meaning in words and its remedy.

use std::fmt;

use serde::Serialize;

/// Ratio of axes above which a Gaussian is a needle. Unit: none.
///
/// In 2D the longer axis is compared with the shorter, in 3D the longest with the middle one (flat
/// Gaussians are what surfaces are made of). This project's choice: a scene trained by the code of
/// 3DGS has none above 54 among 9,080; a scene of another tool has 14,456 among 124,495, as thin as
/// a millionth of their length.
pub const NEEDLE_ASPECT: f32 = 1000.0;

/// Distance from the scene's middle above which a Gaussian is an outlier, in units of the median
/// distance. Unit: none.
///
/// This project's choice: in scenes trained from images the sky is tens of times the median away; a
/// diverged mean is further off.
pub const OUTLIER_DISTANCES: f32 = 1000.0;

/// Magnitude above which a finite opacity logit is out of range. Unit: none.
///
/// exp of more overflows `f32`, so the opacity is exactly 0 or 1 and no gradient can move it. ±∞ is
/// legitimate.
pub const OUT_OF_RANGE_LOGIT: f32 = 88.0;

/// Magnitude above which a colour or an SH coefficient is extreme. Unit: that of colours, whose
/// white is 1.
pub const EXTREME_COLOR: f32 = 1000.0;

/// ln-scale to which a repair raises −∞: that of the smallest normal `f32`, as readers of scales
/// do. Unit: ln(px or world units).
pub const SMALLEST_LOG_SCALE: f32 = -87.336_55;

/// A possible fault of a Gaussian.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Finding {
    /// The mean is NaN or infinite.
    MeanNotFinite,
    /// A ln-scale is NaN or +∞, or so large that the scale is infinite in `f32`.
    ScaleNotFinite,
    /// The rotation is NaN or infinite.
    RotationNotFinite,
    /// The opacity logit is NaN.
    OpacityNotANumber,
    /// The colour, or an SH coefficient, is NaN or infinite.
    ColorNotFinite,
    /// The quaternion is shorter than
    /// [`MIN_QUATERNION_NORM2`](crate::constants::MIN_QUATERNION_NORM2) allows. 3D scenes.
    NoRotation,
    /// A scale is exactly 0: its ln is −∞.
    ZeroScale,
    /// Too small to be resolved: the longest axis is shorter than the distance between neighbouring
    /// `f32` at the mean, or, in 2D, det Σ is below
    /// [`MIN_DETERMINANT_PX4`](crate::constants::MIN_DETERMINANT_PX4). Such a Gaussian is drawn
    /// only if an [`Antialias`](crate::effects::Antialias) widens it, or magnified.
    Vanishing,
    /// Too large: the variance, but not the scale, is infinite in `f32`. Such a Gaussian is drawn
    /// only from afar, where it is smaller in pixels.
    Enormous,
    /// The axes differ by more than [`NEEDLE_ASPECT`].
    Needle,
    /// Mean, scales and rotation equal an earlier Gaussian's, bit for bit (0 and −0 are the
    /// same); opacity and colour may differ.
    Duplicate,
    /// The opacity is below [`ALPHA_CUT`](crate::constants::ALPHA_CUT): under `Over` the Gaussian
    /// is never visible.
    Transparent,
    /// The opacity logit is finite, but beyond [`OUT_OF_RANGE_LOGIT`].
    OpacityOutOfRange,
    /// A colour is beyond [`EXTREME_COLOR`].
    ExtremeColor,
    /// The Gaussian is further than [`OUTLIER_DISTANCES`] from the others.
    Outlier,
    /// The scales of the whole scene look as if they were stored without their logarithm: all ln-scales
    /// are above 0, and spread as sizes do. 3D scenes.
    ActivatedScale,
    /// The opacities of the whole scene look as if they were stored without their logit: all are
    /// between 0 and 1. 3D scenes.
    ActivatedOpacity,
}

/// Action of a repair on a finding, the mildest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Remedy {
    /// None: the Gaussian is drawn, and the image would change without it.
    Leave,
    /// The scale is raised to [`SMALLEST_LOG_SCALE`], which draws the same and can be stored.
    Widen,
    /// The Gaussian, which draws nothing, is removed.
    Remove,
}

impl Finding {
    /// Action of a repair.
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
            | Self::Outlier
            | Self::ActivatedScale
            | Self::ActivatedOpacity => Remedy::Leave,
        }
    }

    /// Whether a Gaussian with this finding is broken.
    pub fn is_broken(self) -> bool {
        self.remedy() != Remedy::Leave
    }
}

/// Distance from the median of scales to their 95th percentile, in units of that to their 5th, above which
/// they are not logarithms. Unit: none; it does not depend on that of the scene.
///
/// This project's choice: the ln-scales of trained scenes have 0.3 to 1, their scales 4 to 12.
pub(super) const SIZE_SKEW: f32 = 2.5;

/// Writes the finding in words that complete "a Gaussian whose …".
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
            Self::ActivatedScale => f.write_str(
                "scale is probably stored as it is, not as its logarithm: all are above 0 and spread as sizes do; \
                 take their logarithm in the program that wrote the file",
            ),
            Self::ActivatedOpacity => f.write_str(
                "opacity is probably stored as it is, not as its logit: all are between 0 and 1; \
                 take their logit in the program that wrote the file",
            ),
        }
    }
}
