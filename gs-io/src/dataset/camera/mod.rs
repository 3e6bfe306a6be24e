//! Cameras: poses, lenses with their distortion, and images of wide angles as the faces of a cube.
//!
//! [`SourceCamera`] is the camera of an image file, [`Lens`] its lens, and [`Pose`] where it stands.
//! [`wide_faces`] says into which faces a fish-eye is split.

mod cube;
mod distortion;
mod lens;
mod pose;
mod source_camera;
mod wide;

pub use self::{
    cube::CubeFace,
    distortion::{AriaFisheye, BrownConrady, Distortion, Fisheye},
    lens::Lens,
    source_camera::SourceCamera,
};
pub(super) use self::{
    cube::{is_two_to_one, shows_all_directions},
    pose::{Pose, affine},
    wide::{faces as wide_faces, mask_border},
};
