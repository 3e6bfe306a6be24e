//! A view of a data set: the files of an image with its pose and camera.

use std::path::PathBuf;

use gs_core::Camera;

use crate::{
    dataset::{AlphaMeaning, SourceCamera, Split},
    image::Orientation,
};

/// An image with its pose and camera.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// The name in the data set: the path below its image folder, with extension if it has one. A
    /// face of a 360° image or of a wide fish-eye adds its own: `image.jpg#front`.
    pub name: String,
    /// The pinhole camera of [`Self::read_image`]: pose, and intrinsics at that size.
    pub camera: Camera,
    /// The camera at the image's full size, before it is scaled down
    /// ([`DatasetSettings::max_side`](crate::dataset::DatasetSettings::max_side)).
    pub full: Camera,
    /// The camera of the image file: its size, intrinsics and lens.
    pub source: SourceCamera,
    /// The image file.
    pub image: PathBuf,
    /// The orientation of the file. Cameras are calibrated on pixels as stored, unless only the
    /// rotated image fits.
    pub orientation: Orientation,
    /// The mask file: an image of the same shape, of any size, whose pixels darker than mid-grey do
    /// not count.
    pub mask: Option<PathBuf>,
    /// The depth map, if there is one.
    pub depth: Option<DepthFile>,
    /// The meaning of the image's alpha channel.
    pub alpha: AlphaMeaning,
    /// The purpose of the view.
    pub split: Split,
}

/// The file of a view's depth map.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthFile {
    /// A grey image or a NumPy array with the aspect ratio of the image.
    pub path: PathBuf,
    /// World units of a stored value of 1, if the data set's format defines them; `None` if values
    /// are only known up to scale and shift.
    pub unit: Option<f32>,
}
