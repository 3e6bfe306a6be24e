//! What a data set's reader has to say: what it left out, and what it changed.

use std::fmt;

use gs_core::counted;
use serde::Serialize;

use crate::image::ImageRemark;

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
        /// What exactly is wrong with the first, where more can be said.
        detail: Option<String>,
    },
    /// Something that is to be said of photographs' files.
    Image {
        /// What.
        remark: ImageRemark,
        /// Of how many.
        count: usize,
        /// The name of the first.
        first: String,
    },
    /// Photographs that are scaled down when they are read.
    Reduced {
        /// How many.
        count: usize,
        /// The most pixels that their longer side keeps.
        max_side: u32,
        /// (columns, rows) of the first one.
        from: (u32, u32),
        /// (columns, rows) that it gets.
        to: (u32, u32),
    },
    /// Masks that the data set names are not there, so that every pixel of their photographs counts.
    MasksMissing {
        /// How many.
        count: usize,
        /// The first, as the data set names it.
        first: String,
    },
    /// The data set names images of depths, which nothing here makes use of.
    DepthsUnused {
        /// How many.
        count: usize,
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
    /// The image file cannot be read, or is cut short.
    BadImage,
    /// The mask cannot be read, or has another shape than the image.
    BadMask,
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
            Self::BadMask => "the mask cannot be read, or has another shape than the image",
            Self::OtherShape => "the image has another shape than its camera",
            Self::NoCamera => "the camera is not in the model",
            Self::BadCamera => "the camera's size, focal lengths or lens are not possible",
            Self::Panorama => "a panorama, which must be cut into perspective images first",
            Self::BadPose => "the pose is not finite or not a rotation",
            Self::SameName => "another view has the same name",
        })
    }
}

impl fmt::Display for Remark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Skipped { why, count, first, detail: None } => write!(f, "{count} skipped: {why} (first: {first})"),
            Self::Skipped { why, count, first, detail: Some(detail) } => {
                write!(f, "{count} skipped: {why} (first: {first}: {detail})")
            }
            Self::Image { remark, count, first } => {
                write!(f, "{}: {remark} (first: {first})", counted(*count, "image"))
            }
            Self::Reduced { count, max_side, from, to } => {
                let ((w, h), (width, height)) = (from, to);
                write!(
                    f,
                    "{count} scaled down to {max_side} px on the longer side (first: {w}x{h} to {width}x{height} px)"
                )
            }
            Self::MasksMissing { count, first } => write!(f, "{count} without the mask that is named (first: {first})"),
            Self::DepthsUnused { count } => write!(f, "{count} with a depth image, which is not used"),
            Self::Undistorted { count, lens } => write!(f, "{count} undistorted when read ({lens} lens)"),
            Self::Scaled { count, from, to } => {
                let ((w, h), (width, height)) = (from, to);
                write!(f, "{count} with intrinsics scaled to the image (first: {w}x{h} to {width}x{height} px)")
            }
            Self::NoPoints => f.write_str("no points"),
            Self::PointsNotFinite { count } => write!(f, "{} left out: not finite", counted(*count, "point")),
            Self::PointsMissing { file } => write!(f, "no points: there is no file {file}"),
            Self::OtherModels { count } => write!(f, "{} beside this one, not read", counted(*count, "more model")),
            Self::NothingHeldOut => f.write_str("nothing held out: too few views"),
        }
    }
}
