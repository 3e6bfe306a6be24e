//! The findings of an examination, each with its meaning in words and its remedy.

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

crate::choices! {
    /// A possible fault of a Gaussian. Its summary completes "a Gaussian whose …".
    #[derive(PartialOrd, Ord)]
    #[non_exhaustive]
    pub enum Finding {
        /// The mean is NaN or infinite.
        MeanNotFinite = "mean-not-finite": "mean is NaN or infinite",
        /// A ln-scale is NaN or +∞, or so large that the scale is infinite in `f32`.
        ScaleNotFinite = "scale-not-finite": "scale is NaN or infinite",
        /// The rotation is NaN or infinite.
        RotationNotFinite = "rotation-not-finite": "rotation is NaN or infinite",
        /// The opacity logit is NaN.
        OpacityNotANumber = "opacity-not-a-number": "opacity is NaN",
        /// The colour, or an SH coefficient, is NaN or infinite.
        ColorNotFinite = "color-not-finite": "colour is NaN or infinite",
        /// The quaternion is shorter than
        /// [`MIN_QUATERNION_NORM2`](crate::constants::MIN_QUATERNION_NORM2) allows. 3D scenes.
        NoRotation = "no-rotation": "quaternion is 0",
        /// A scale is exactly 0: its ln is −∞.
        ZeroScale = "zero-scale": "scale is 0",
        /// Too small to be resolved: the longest axis is shorter than the distance between neighbouring
        /// `f32` at the mean, or, in 2D, det Σ is below
        /// [`MIN_DETERMINANT_PX4`](crate::constants::MIN_DETERMINANT_PX4). Such a Gaussian is drawn
        /// only if an [`Antialias`](crate::effects::Antialias) widens it, or magnified.
        Vanishing = "vanishing": "size is too small to be resolved; drawn only if widened",
        /// Too large: the variance, but not the scale, is infinite in `f32`. Such a Gaussian is drawn
        /// only from afar, where it is smaller in pixels.
        Enormous = "enormous": "size is too large for its square; drawn only from afar",
        /// The axes differ by more than [`NEEDLE_ASPECT`].
        Needle = "needle": "shape is a needle, more than 1000 times as long as wide",
        /// Mean, scales and rotation equal an earlier Gaussian's, bit for bit (0 and −0 are the
        /// same); opacity and colour may differ.
        Duplicate = "duplicate": "place and shape are those of an earlier one",
        /// The opacity is below [`ALPHA_CUT`](crate::constants::ALPHA_CUT): under `Over` the Gaussian
        /// is never visible.
        Transparent = "transparent": "opacity is below 1/255, never seen",
        /// The opacity logit is finite, but beyond [`OUT_OF_RANGE_LOGIT`].
        OpacityOutOfRange = "opacity-out-of-range": "opacity logit is finite but beyond ±88",
        /// A colour is beyond [`EXTREME_COLOR`].
        ExtremeColor = "extreme-color": "colour is beyond ±1000",
        /// The Gaussian is further than [`OUTLIER_DISTANCES`] from the others.
        Outlier = "outlier": "place is more than 1000 times as far off as half of them",
        /// The scales of the whole scene look as if they were stored without their logarithm: all ln-scales
        /// are above 0, and spread as sizes do. 3D scenes.
        ActivatedScale = "activated-scale":
            "scale is probably stored as it is, not as its logarithm: all are above 0 and spread as sizes do; \
                 take their logarithm in the program that wrote the file",
        /// The opacities of the whole scene look as if they were stored without their logit: all are
        /// between 0 and 1. 3D scenes.
        ActivatedOpacity = "activated-opacity":
            "opacity is probably stored as it is, not as its logit: all are between 0 and 1; \
                 take their logit in the program that wrote the file",
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Choice as _;

    #[test]
    fn summaries_have_the_numbers_that_findings_are_judged_by() {
        for (finding, number) in [
            (Finding::Needle, NEEDLE_ASPECT),
            (Finding::OpacityOutOfRange, OUT_OF_RANGE_LOGIT),
            (Finding::ExtremeColor, EXTREME_COLOR),
            (Finding::Outlier, OUTLIER_DISTANCES),
        ] {
            assert!(finding.summary().contains(&number.to_string()), "{finding}");
        }
    }
}
