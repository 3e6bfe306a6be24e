//! 2D scenes: the stages before `bin` and after `blend_bwd`.

mod adam;
mod buffers;
mod kind;
mod project;
mod project_bwd;
mod solve_colors;
mod splats;

pub use splats::Splats2d;
