//! The files of a view: its image, undistorted and scaled, and its depth map.
//!
//! [`View::read_image`](super::View::read_image) and [`View::read_depth`](super::View::read_depth)
//! read them, [`read_images`] those of several views.

mod depth;
mod posed_image;
mod resample;
mod shrink;

pub use self::{
    depth::{DepthFile, DepthMap},
    posed_image::{PosedImage, read_images},
};
pub(super) use self::{
    depth::{check as check_depth, find as find_depth},
    shrink::{resized, within},
};
