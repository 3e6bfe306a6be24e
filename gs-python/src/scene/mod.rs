//! Scenes and cameras.

pub(crate) mod camera;
pub(crate) mod scene2d;
pub(crate) mod scene3d;
