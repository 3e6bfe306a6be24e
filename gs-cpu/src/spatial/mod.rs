//! Spatial scenes: what stands before `bin` and after `blend_bwd`.

mod adam;
mod cloud;
mod depth_sort;
mod kind;
mod project;
mod project_bwd;

pub use cloud::SpatialCloud;
