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
        /// Name of the first; the first few names if the image files do not exist.
        first: String,
        /// Details about the first, if there are any.
        detail: Option<String>,
    },
    /// Image files whose names differ from those in the data set in letter case, Unicode form,
    /// separators, extension or folder.
    Renamed {
        /// Number of images.
        count: usize,
        /// Name of the first.
        first: String,
        /// Its file.
        file: String,
    },
    /// The image files are in another folder than the data set says.
    OtherFolder {
        /// The folder.
        folder: String,
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
    /// The data set refers to depth maps of images that are split into faces, which are not used.
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
    /// Wide fish-eye images, each of which is several views of 90°.
    SplitFisheye {
        /// Number of images.
        count: usize,
        /// Number of views.
        views: usize,
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
    /// The principal point is outside of the image, as in a cut-out.
    OffCenter {
        /// Number of images.
        count: usize,
        /// Name of the first.
        first: String,
        /// Its key and value, and the side of the image in px.
        fault: String,
    },
    /// A folder of masks that are not used.
    MasksUnused {
        /// The folder.
        folder: &'static str,
        /// How masks are named in such a data set.
        how: &'static str,
    },
    /// Cameras and points are relative to a [frame](crate::WorldFrame) that `f32` can resolve.
    Frame {
        /// The frame in words.
        frame: String,
    },
    /// The data set has no points, so a scene must start at random or from a file.
    NoPoints,
    /// The file of points has no colours that are known, so its points are grey.
    PointsWithoutColor {
        /// The file, as the data set names it.
        file: String,
        /// The properties of its vertices.
        properties: Vec<String>,
    },
    /// Points that were left out because they are not finite.
    PointsNotFinite {
        /// Number of points.
        count: usize,
    },
    /// Points that were left out because an earlier one is at the same place.
    PointsCoincide {
        /// Number of points.
        count: usize,
    },
    /// The file of points does not exist.
    PointsMissing {
        /// The file, as the data set names it.
        file: String,
    },
    /// The data set has several COLMAP models; the one with most photographs is read.
    OtherModels {
        /// The folder of the model, and its number of images.
        read: String,
        /// The same of the others.
        others: Vec<String>,
    },
    /// The binary files of a COLMAP model are damaged, so its text files are read.
    TextModel {
        /// What is wrong with the binary files.
        error: String,
    },
    /// The data set has a split, which the settings replace.
    SplitReplaced,
    /// The split would leave no view for training, so every view is used for training.
    NothingHeldOut,
    /// The data set has a split without usable test or validation views.
    NoTestViews,
    /// The data set has no usable test views, so that its validation views are held out for tests.
    ValidationTested {
        /// Number of views.
        count: usize,
    },
    /// Names in the lists of a split that fit a frame only without regard to folder, letter case or
    /// extension.
    ListedOtherwise {
        /// Number of names.
        count: usize,
        /// The first.
        listed: String,
        /// The name of its frame.
        frame: String,
    },
    /// Names in the lists of a split that belong to no frame.
    ListedWithoutFrame {
        /// Number of names.
        count: usize,
        /// The first.
        first: String,
    },
    /// Frames that are listed both for training and as held out. They are held out.
    ListedTwice {
        /// Number of frames.
        count: usize,
        /// The name of the first.
        first: String,
    },
    /// Frames in no list are used for training, because there is no list for training.
    UnlistedTrained {
        /// Number of frames.
        count: usize,
        /// The name of the first.
        first: String,
    },
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
    /// There is no pose.
    NoPose,
    /// The pose has NaN or infinite numbers.
    PoseNotFinite,
    /// The pose is not a rotation, or its position is out of range.
    BadPose,
    /// An earlier view has the same name.
    SameName,
    /// The data set lists the views for training and for tests, and this one in neither list.
    Unlisted,
    /// The data set marks the image as bad.
    MarkedBad,
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
            Self::NoPose => "there is no pose (transform_matrix)",
            Self::PoseNotFinite => "the pose contains NaN or infinity",
            Self::BadPose => "the pose is not a rotation, or its position is out of range",
            Self::SameName => "another view has the same name",
            Self::Unlisted => "not in any list of the data set's split",
            Self::MarkedBad => "marked as bad in the data set",
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
            Self::Renamed { count, first, file } => {
                write!(f, "{} found under another name (first: {file} for {first})", images(*count))
            }
            Self::OtherFolder { folder } => {
                write!(f, "images taken from the folder {folder}, the only one that has them")
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
                write!(
                    f,
                    "{} not used: depth maps of images that are split into faces are not supported",
                    counted(*count, "depth map")
                )
            }
            Self::Undistorted { count, lens } => {
                write!(f, "{} with lens distortion ({lens}), undistorted when read", images(*count))
            }
            Self::Split { count } => {
                let images = counted(*count, "360° image");
                write!(f, "{images} split into the six faces of a cube each: {} views", 6 * count)
            }
            Self::SplitFisheye { count, views } => {
                write!(f, "{} split into 90° faces: {views} views", counted(*count, "wide fish-eye image"))
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
            Self::OffCenter { count, first, fault } => {
                let images = images(*count);
                write!(
                    f,
                    "{images} with a principal point outside of the image, as in a cut-out (first: {first}: {fault})"
                )
            }
            Self::MasksUnused { folder, how } => write!(f, "{folder}/ is not used: {how}"),
            Self::Frame { frame } => {
                write!(
                    f,
                    "the scene has a frame of its own, because 32-bit numbers do not resolve the data set's coordinates: {frame}"
                )
            }
            Self::NoPoints => f.write_str("no points"),
            Self::PointsWithoutColor { file, properties } => write!(
                f,
                "points are grey: {file} has no colours by a known name, such as red, green and blue (its vertices have {})",
                properties.join(", ")
            ),
            Self::PointsNotFinite { count } => write!(f, "{} left out: not finite", counted(*count, "point")),
            Self::PointsCoincide { count } => {
                write!(f, "{} left out: at the same place as others", counted(*count, "point"))
            }
            Self::PointsMissing { file } => write!(f, "no points: there is no file {file}"),
            Self::OtherModels { read, others } => {
                write!(f, "of several COLMAP models, {read} is read, not {}", others.join(", "))
            }
            Self::TextModel { error } => write!(f, "the text files of the COLMAP model are read, because {error}"),
            Self::SplitReplaced => f.write_str("the data set's own split is not used, as another was asked for"),
            Self::NothingHeldOut => f.write_str("no view held out for tests, because there are too few"),
            Self::NoTestViews => f.write_str(
                "no view held out for tests: the data set's split has no usable test or validation views, so quality \
                 is measured on training views",
            ),
            Self::ValidationTested { count } => {
                write!(f, "{} held out for tests: there are no usable test views", counted(*count, "validation view"))
            }
            Self::ListedOtherwise { count, listed, frame } => {
                let names = counted(*count, "name");
                write!(
                    f,
                    "{names} in the lists of the split taken for similar names of frames (first: {listed} for {frame})"
                )
            }
            Self::ListedWithoutFrame { count, first } => {
                write!(f, "{} in the lists of the split without a frame (first: {first})", counted(*count, "name"))
            }
            Self::ListedTwice { count, first } => {
                let frames = counted(*count, "frame");
                write!(f, "{frames} listed both for training and for tests or validation, held out (first: {first})")
            }
            Self::UnlistedTrained { count, first } => {
                let frames = counted(*count, "frame");
                write!(
                    f,
                    "{frames} in no list of the split used for training, as none is listed for it (first: {first})"
                )
            }
        }
    }
}
