//! Remarks on a data set: what was left out or changed when it was read.

use std::fmt;

use gs_core::counted;
use serde::Serialize;

use crate::image::ImageRemark;

/// A remark on a data set.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Remark {
    /// Views that cannot be used.
    Skipped {
        /// The reason.
        why: Skip,
        /// Number of views.
        count: usize,
        /// Name of the first, in the order of the data set.
        first: String,
        /// Details about the first, if there are any.
        detail: Option<String>,
    },
    /// A remark on image files.
    Image {
        /// The remark.
        remark: ImageRemark,
        /// Number of images.
        count: usize,
        /// Name of the first.
        first: String,
    },
    /// Images are scaled down when they are read.
    Reduced {
        /// Number of images.
        count: usize,
        /// The most pixels of their longer side.
        max_side: u32,
        /// Columns and rows of the first.
        from: (u32, u32),
        /// Columns and rows of the first after scaling.
        to: (u32, u32),
    },
    /// Masks do not exist, so every pixel of their images counts.
    MasksMissing {
        /// Number of masks.
        count: usize,
        /// The first, as the data set names it.
        first: String,
    },
    /// Depth maps that the data set refers to do not exist.
    DepthsMissing {
        /// Number of depth maps.
        count: usize,
        /// The first, as the data set names it.
        first: String,
    },
    /// Depth maps that cannot be read, or have another shape than their images. They are an error
    /// where they are read.
    DepthsUnusable {
        /// Number of depth maps.
        count: usize,
        /// The error of the first.
        first: String,
    },
    /// The data set refers to depth maps of 360° images, which are not used.
    DepthsUnused {
        /// Number of images.
        count: usize,
    },
    /// Images are undistorted when they are read.
    Undistorted {
        /// Number of images.
        count: usize,
        /// The lens model of these images.
        lens: &'static str,
    },
    /// 360° images, each of which is six views.
    Split {
        /// Number of images.
        count: usize,
    },
    /// Images have another size than their camera's calibration, and intrinsics were scaled.
    Scaled {
        /// Number of images.
        count: usize,
        /// Columns and rows of the first one's calibration.
        from: (u64, u64),
        /// Columns and rows of the first.
        to: (u32, u32),
    },
    /// Cameras and points are relative to a [frame](crate::WorldFrame) that `f32` can resolve.
    Frame {
        /// The frame in words.
        frame: String,
    },
    /// The data set has no points, so a scene must start at random or from a file.
    NoPoints,
    /// Points that were left out because they are not finite.
    PointsNotFinite {
        /// Number of points.
        count: usize,
    },
    /// The file of points does not exist.
    PointsMissing {
        /// The file, as the data set names it.
        file: String,
    },
    /// The data set has several COLMAP models that are not connected; only the first is read.
    OtherModels {
        /// Number of other models.
        count: usize,
    },
    /// The split would leave no view for training, so every view is used for training.
    NothingHeldOut,
}

/// Why a view cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Skip {
    /// The image file does not exist.
    NoImage,
    /// The image file cannot be read, or is truncated.
    BadImage,
    /// The mask cannot be read, or has another shape than the image.
    BadMask,
    /// The image has another shape than its camera.
    OtherShape,
    /// The camera does not exist.
    NoCamera,
    /// Size, focal lengths, principal point or lens are not possible.
    BadCamera,
    /// A 360° image that is not twice as wide as high.
    Panorama,
    /// The pose is not finite or not a rotation.
    BadPose,
    /// An earlier view has the same name.
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
            Self::Panorama => "a 360° image (equirectangular) must be twice as wide as high",
            Self::BadPose => "the pose is not finite or not a rotation",
            Self::SameName => "another view has the same name",
        })
    }
}

fn images(count: usize) -> String {
    counted(count, "image")
}

impl fmt::Display for Remark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Skipped { why, count, first, detail } => {
                let detail = detail.as_ref().map_or_else(String::new, |detail| format!(": {detail}"));
                write!(f, "{} skipped: {why} (first: {first}{detail})", images(*count))
            }
            Self::Image { remark, count, first } => {
                write!(f, "{}: {remark} (first: {first})", images(*count))
            }
            Self::Reduced { count, max_side, from, to } => {
                let ((w, h), (width, height)) = (from, to);
                write!(
                    f,
                    "{} scaled down to {max_side} px on the longer side (first: {w}x{h} to {width}x{height} px)",
                    images(*count)
                )
            }
            Self::MasksMissing { count, first } => {
                write!(f, "{} not found, so all pixels of the image count (first: {first})", counted(*count, "mask"))
            }
            Self::DepthsMissing { count, first } => {
                write!(f, "{} not found (first: {first})", counted(*count, "depth map"))
            }
            Self::DepthsUnusable { count, first } => {
                write!(f, "{} that a training could not use (first: {first})", counted(*count, "depth map"))
            }
            Self::DepthsUnused { count } => {
                write!(f, "{} not used: depth maps of 360° images are not supported", counted(*count, "depth map"))
            }
            Self::Undistorted { count, lens } => {
                write!(f, "{} with lens distortion ({lens}), undistorted when read", images(*count))
            }
            Self::Split { count } => {
                let images = counted(*count, "360° image");
                write!(f, "{images} split into the six faces of a cube each: {} views", 6 * count)
            }
            Self::Scaled { count, from, to } => {
                let ((w, h), (width, height)) = (from, to);
                let images = images(*count);
                write!(
                    f,
                    "{images} of another size than their camera, whose intrinsics were scaled (first: {w}x{h} to \
                     {width}x{height} px)"
                )
            }
            Self::Frame { frame } => {
                write!(f, "cameras and points are taken into a frame that suits 32-bit numbers: {frame}")
            }
            Self::NoPoints => f.write_str("no points"),
            Self::PointsNotFinite { count } => write!(f, "{} left out: not finite", counted(*count, "point")),
            Self::PointsMissing { file } => write!(f, "no points: there is no file {file}"),
            Self::OtherModels { count } => {
                write!(f, "{} in the data set not read: only the first is", counted(*count, "more COLMAP model"))
            }
            Self::NothingHeldOut => f.write_str("no view held out for tests, because there are too few"),
        }
    }
}
