//! Cameras: poses, lenses with their distortion, and images of wide angles as the faces of a cube.
//!
//! [`Intrinsics`] are the calibration that a file states; [`SourceCamera`] is the camera of an image,
//! [`Lens`] its lens, and [`Pose`] where it stands. [`wide_faces`] splits a fish-eye into faces.

mod cube;
mod distortion;
mod intrinsics;
mod lens;
mod pose;
mod source_camera;
mod wide;

pub use self::source_camera::SourceCamera;
pub(super) use self::{
    cube::{CubeFace, is_two_to_one, shows_all_directions},
    distortion::{AriaFisheye, BrownConrady, Distortion, Fisheye},
    intrinsics::{Focal, Intrinsics},
    lens::Lens,
    pose::{Pose, affine},
    wide::faces as wide_faces,
};
