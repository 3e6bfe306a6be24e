//! The files of a view: its image, undistorted and scaled, and its depth map.
//!
//! [`View::read_image`] and [`View::read_depth`] read them, [`View::read_window`] a part of the image,
//! [`read_images`] the images of several views.

mod border;
mod compact_image;
mod depth;
mod posed_image;
mod read_image;
mod resample;
mod shape;
mod shrink;
mod view;
mod window;

pub use self::{
    compact_image::CompactImage,
    depth::DepthMap,
    posed_image::PosedImage,
    read_image::read_images,
    view::{DepthFile, View},
    window::Window,
};
pub(super) use self::{
    depth::{check as check_depth, find as find_depth},
    shape::same_shape,
    shrink::{resized, within},
};
