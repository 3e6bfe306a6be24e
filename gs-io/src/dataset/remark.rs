//! What a data set's reader has to say: what it left out, and what it changed.

use std::fmt;

use gs_core::counted;
use serde::Serialize;

/// Something worth knowing about a data set that was read.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Remark {
    /// Views that cannot be used.
    Skipped {
        /// Why.
        why: Skip,
        /// How many.
        count: usize,
        /// The name of the first, in the order of the data set.
        first: String,
    },
    /// Photographs that are undistorted when they are read.
    Undistorted {
        /// How many.
        count: usize,
        /// Their lens.
        lens: &'static str,
    },
    /// Photographs of another size than the camera's calibration, whose intrinsics were scaled.
    Scaled {
        /// How many.
        count: usize,
        /// (columns, rows) of the first one's calibration.
        from: (u64, u64),
        /// (columns, rows) of the first one.
        to: (u32, u32),
    },
    /// There are no points: a scene must start at random or from a file.
    NoPoints,
    /// Points that were left out because they are not finite.
    PointsNotFinite {
        /// How many.
        count: usize,
    },
    /// The data set names a file of points that is not there.
    PointsMissing {
        /// The file, as the data set names it.
        file: String,
    },
    /// COLMAP made several models that do not hang together; only the first is read.
    OtherModels {
        /// How many others.
        count: usize,
    },
    /// A split would have left nothing to train with, so that every view is trained with.
    NothingHeldOut,
}

/// Why a view cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Skip {
    /// There is no image file of its name.
    NoImage,
    /// The image file's header cannot be read.
    BadImage,
    /// The image has another shape than the camera that is said to have taken it.
    OtherShape,
    /// The model has no camera of its number.
    NoCamera,
    /// Size, focal lengths, principal point or lens are not possible.
    BadCamera,
    /// A panorama, which no pinhole camera can show.
    Panorama,
    /// The pose is not finite, or no rotation.
    BadPose,
    /// Another view before it has the same name.
    SameName,
}

impl fmt::Display for Skip {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NoImage => "no image file",
            Self::BadImage => "the image file cannot be read",
            Self::OtherShape => "the image has another shape than its camera",
            Self::NoCamera => "the camera is not in the model",
            Self::BadCamera => "the camera's size, focal lengths or lens are not possible",
            Self::Panorama => "a panorama, which must be cut into perspective images first",
            Self::BadPose => "the pose is not finite or no rotation",
            Self::SameName => "another view has the same name",
        })
    }
}

impl fmt::Display for Remark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Skipped { why, count, first } => write!(f, "{count} skipped: {why} (first: {first})"),
            Self::Undistorted { count, lens } => write!(f, "{count} undistorted when read ({lens} lens)"),
            Self::Scaled { count, from, to } => {
                let ((w, h), (width, height)) = (from, to);
                write!(f, "{count} with intrinsics scaled to the image (first: {w}x{h} to {width}x{height} px)")
            }
            Self::NoPoints => f.write_str("no points"),
            Self::PointsNotFinite { count } => write!(f, "{} left out: not finite", counted(*count, "point")),
            Self::PointsMissing { file } => write!(f, "no points: there is no file {file}"),
            Self::OtherModels { count } => write!(f, "{count} more models beside this one, not read"),
            Self::NothingHeldOut => f.write_str("nothing held out: too few views"),
        }
    }
}
