//! 2D scenes: what stands before `scan` and after `blend_bwd`.

mod kind;
mod solve_colors;
mod state;
