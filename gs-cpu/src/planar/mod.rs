//! Planar scenes: what stands before `bin` and after `blend_bwd`.

mod adam;
mod cloud;
mod kind;
mod project;
mod project_bwd;
mod solve_colors;

pub use cloud::PlanarCloud;
