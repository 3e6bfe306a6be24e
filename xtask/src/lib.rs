//! The commands of `cargo xtask`, and what their tests in `tests/` share with them.

pub mod cluster;
pub mod dist;
pub mod poses;
pub mod python;
pub mod system;
pub mod test;
pub mod web;
