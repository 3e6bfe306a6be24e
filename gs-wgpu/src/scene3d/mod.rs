//! 3D scenes: what stands before `scan` and after `blend_bwd`.

mod kind;
mod stages;
mod state;
