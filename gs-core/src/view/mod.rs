//! What a scene is looked at through.

mod camera;
mod canvas;

pub use camera::Camera;
pub use canvas::Canvas;
