//! What a scene is looked at through.

mod camera;
mod canvas;
mod path;

pub use camera::Camera;
pub use canvas::Canvas;
pub use path::{Bulk, CameraPath, Ends, Key, Orbit};
