//! Views of a scene, and paths of cameras.

mod camera;
mod camera_gradient;
mod canvas;
mod path;

pub use camera::Camera;
pub use camera_gradient::CameraGradient;
pub use canvas::Canvas;
pub use path::{Bulk, CameraPath, Ends, Key, Orbit};
