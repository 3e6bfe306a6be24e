//! 3D scenes: the stages before `scan` and after `blend_bwd`.

mod kind;
mod state;
