//! The program gs.
fn main() {}
