//! 3D scenes: the stages before `bin` and after `blend_bwd`.

mod adam;
mod depth_sort;
mod kind;
mod moments;
mod own;
mod project;
mod project_bwd;
mod splats;

pub use splats::Splats3d;
