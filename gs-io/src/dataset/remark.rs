//! Remarks on a data set: what was left out or changed when it was read.

use gs_core::counted;
use thiserror::Error;

use crate::image::ImageRemark;

/// The kind of file for messages about one that is something else.
pub(super) const FILE: &str = "a file of a data set";

/// A remark on a data set. The order is that of reports.
///
/// A remark is not a failure: `Error` is derived only for the texts (`Display`). The same is true
/// of [`Skip`], [`SplitOrigin`](super::SplitOrigin), [`ImageRemark`] and
/// [`ConversionLoss`](crate::ConversionLoss).
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Error)]
#[non_exhaustive]
pub enum Remark {
    /// Views that cannot be used.
    #[error(
        "{} skipped: {why} (first: {first}{})",
        images(*count), detail.as_ref().map_or_else(String::new, |detail| format!(": {detail}"))
    )]
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
    #[error("{} found under another name (first: {file} for {first})", images(*count))]
    Renamed {
        /// Number of images.
        count: usize,
        /// Name of the first.
        first: String,
        /// Its file.
        file: String,
    },
    /// The image files are in another folder than the data set says.
    #[error("images taken from the folder {folder}, the only one that has them")]
    OtherFolder {
        /// The folder.
        folder: String,
    },
    /// A remark on image files.
    #[error("{}: {remark} (first: {first})", images(*count))]
    Image {
        /// The remark.
        remark: ImageRemark,
        /// Number of images.
        count: usize,
        /// Name of the first.
        first: String,
    },
    /// 360° images, each of which is six views.
    #[error("{} split into the six faces of a cube each: {} views", counted(*count, "360° image"), 6 * count)]
    Split {
        /// Number of images.
        count: usize,
    },
    /// Wide fish-eye images, each of which is several views of 90°.
    #[error("{} split into 90° faces: {views} views", counted(*count, "wide fish-eye image"))]
    SplitFisheye {
        /// Number of images.
        count: usize,
        /// Number of views.
        views: usize,
    },
    /// Images have another size than their camera's calibration, and intrinsics were scaled.
    #[error(
        "{} of another size than their camera, whose intrinsics were scaled (first: {}x{} to {}x{} px)",
        images(*count), from.0, from.1, to.0, to.1
    )]
    Scaled {
        /// Number of images.
        count: usize,
        /// Columns and rows of the first one's calibration.
        from: (u64, u64),
        /// Columns and rows of the first.
        to: (u32, u32),
    },
    /// Images are scaled down when they are read.
    #[error(
        "{} scaled down to {max_side} px on the longer side (first: {}x{} to {}x{} px)",
        images(*count), from.0, from.1, to.0, to.1
    )]
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
    /// The principal point is outside of the image, as in a cut-out.
    #[error(
        "{} with a principal point outside of the image, as in a cut-out (first: {first}: {fault})",
        images(*count)
    )]
    OffCenter {
        /// Number of images.
        count: usize,
        /// Name of the first.
        first: String,
        /// Its key and value, and the side of the image in px.
        fault: String,
    },
    /// Images are undistorted when they are read.
    #[error("{} with lens distortion ({lens}), undistorted when read", images(*count))]
    Undistorted {
        /// The lens model of these images.
        lens: &'static str,
        /// Number of images.
        count: usize,
    },
    /// Depth maps that cannot be read, or have another shape than their images. They are an error
    /// where they are read.
    #[error("{} that a training could not use (first: {first})", counted(*count, "depth map"))]
    DepthsUnusable {
        /// Number of depth maps.
        count: usize,
        /// The error of the first.
        first: String,
    },
    /// Masks do not exist, so every pixel of their images counts.
    #[error("{} not found, so all pixels of the image count (first: {first})", counted(*count, "mask"))]
    MasksMissing {
        /// Number of masks.
        count: usize,
        /// The first, as the data set names it.
        first: String,
    },
    /// Depth maps that the data set refers to do not exist.
    #[error("{} not found (first: {first})", counted(*count, "depth map"))]
    DepthsMissing {
        /// Number of depth maps.
        count: usize,
        /// The first, as the data set names it.
        first: String,
    },
    /// The data set refers to depth maps of images that are split into faces, which are not used.
    #[error(
        "{} not used: depth maps of images that are split into faces are not supported",
        counted(*count, "depth map")
    )]
    DepthsUnused {
        /// Number of images.
        count: usize,
    },
    /// A folder of masks that are not used.
    #[error("{folder}/ is not used: {how}")]
    MasksUnused {
        /// The folder.
        folder: &'static str,
        /// How masks are named in such a data set.
        how: &'static str,
    },
    /// Cameras and points are relative to a [frame](crate::WorldFrame) that `f32` can resolve.
    #[error(
        "the scene has a frame of its own, because 32-bit numbers do not resolve the data set's coordinates: {frame}"
    )]
    Frame {
        /// The frame in words.
        frame: String,
    },
    /// The data set has no points, so a scene must start at random or from a file.
    #[error("no points")]
    NoPoints,
    /// The file of points has no colours that are known, so its points are grey.
    #[error(
        "points are grey: {file} has no colours by a known name, such as red, green and blue (its vertices have {})",
        properties.join(", ")
    )]
    PointsWithoutColor {
        /// The file, as the data set names it.
        file: String,
        /// The properties of its vertices.
        properties: Vec<String>,
    },
    /// Points that were left out because they are not finite.
    #[error("{} left out: not finite", counted(*count, "point"))]
    PointsNotFinite {
        /// Number of points.
        count: usize,
    },
    /// Points that were left out because an earlier one is at the same place.
    #[error("{} left out: at the same place as others", counted(*count, "point"))]
    PointsCoincide {
        /// Number of points.
        count: usize,
    },
    /// The file of points does not exist.
    #[error("no points: there is no file {file}")]
    PointsMissing {
        /// The file, as the data set names it.
        file: String,
    },
    /// The data set has several models; the one with most photographs is read.
    #[error("of several models, {read} is read, not {}", others.join(", "))]
    OtherModels {
        /// The folder of the model, and its number of images.
        read: String,
        /// The same of the others.
        others: Vec<String>,
    },
    /// The binary files of a COLMAP model are damaged, so its text files are read.
    #[error("the text files of the COLMAP model are read, because {error}")]
    TextModel {
        /// What is wrong with the binary files.
        error: String,
    },
    /// The data set has a split, which the settings replace.
    #[error("the data set's own split is not used, as another was asked for")]
    SplitReplaced,
    /// The split would leave no view for training, so every view is used for training.
    #[error("no view held out for tests, because there are too few")]
    NothingHeldOut,
    /// The data set has a split without usable test or validation views.
    #[error(
        "no view held out for tests: the data set's split has no usable test or validation views, so quality is \
             measured on training views"
    )]
    NoTestViews,
    /// The data set has no usable test views, so that its validation views are held out for tests.
    #[error("{} held out for tests: there are no usable test views", counted(*count, "validation view"))]
    ValidationTested {
        /// Number of views.
        count: usize,
    },
    /// Names in the lists of a split that fit a frame only without regard to folder, letter case or
    /// extension.
    #[error(
        "{} in the lists of the split taken for similar names of frames (first: {listed} for {frame})",
        counted(*count, "name")
    )]
    ListedOtherwise {
        /// Number of names.
        count: usize,
        /// The first.
        listed: String,
        /// The name of its frame.
        frame: String,
    },
    /// Names in the lists of a split that belong to no frame.
    #[error("{} in the lists of the split without a frame (first: {first})", counted(*count, "name"))]
    ListedWithoutFrame {
        /// Number of names.
        count: usize,
        /// The first.
        first: String,
    },
    /// Frames that are listed both for training and as held out. They are held out.
    #[error(
        "{} listed both for training and for tests or validation, held out (first: {first})",
        counted(*count, "frame")
    )]
    ListedTwice {
        /// Number of frames.
        count: usize,
        /// The name of the first.
        first: String,
    },
    /// Frames in no list are used for training, because there is no list for training.
    #[error(
        "{} in no list of the split used for training, as none is listed for it (first: {first})",
        counted(*count, "frame")
    )]
    UnlistedTrained {
        /// Number of frames.
        count: usize,
        /// The name of the first.
        first: String,
    },
}

/// Why a view cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Error)]
#[non_exhaustive]
pub enum Skip {
    /// The image file does not exist.
    #[error("no image file")]
    NoImage,
    /// The image file cannot be read, or is truncated.
    #[error("the image file cannot be read")]
    BadImage,
    /// The mask cannot be read, or has another shape than the image.
    #[error("the mask cannot be read, or has another shape than the image")]
    BadMask,
    /// The image has another shape than its camera.
    #[error("the image has another shape than its camera")]
    OtherShape,
    /// The camera does not exist.
    #[error("the camera is not in the model")]
    NoCamera,
    /// Size, focal lengths, principal point or lens are not possible.
    #[error("the camera's size, focal lengths or lens are not possible")]
    BadCamera,
    /// A 360° image that is not twice as wide as high.
    #[error("a 360° image (equirectangular) must be twice as wide as high")]
    Panorama,
    /// There is no pose.
    #[error("there is no pose")]
    NoPose,
    /// The pose has NaN or infinite numbers.
    #[error("the pose contains NaN or infinity")]
    PoseNotFinite,
    /// The pose is not a rotation, or its position is out of range.
    #[error("the pose is not a rotation, or its position is out of range")]
    BadPose,
    /// An earlier view has the same name.
    #[error("another view has the same name")]
    SameName,
    /// The data set lists the views for training and for tests, and this one in neither list.
    #[error("not in any list of the data set's split")]
    Unlisted,
    /// The data set marks the image as bad.
    #[error("marked as bad in the data set")]
    MarkedBad,
}

fn images(count: usize) -> String {
    counted(count, "image")
}
