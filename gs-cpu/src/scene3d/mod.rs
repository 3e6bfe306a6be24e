//! 3D scenes: the stages before `bin` and after `blend_bwd`.

mod adam;
mod buffers;
mod camera_sum;
mod depth_sort;
mod kind;
mod lanes_project;
mod lanes_vjp;
mod moments;
mod project;
mod project_bwd;
mod splats;

pub use splats::Splats3d;
