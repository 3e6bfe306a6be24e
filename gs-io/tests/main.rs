//! Tests of readers and writers. One binary for all modules, so that the tests link once.

mod containers;
mod flat_ply;
mod fuzzed;
mod gsi;
mod images;
mod scene3d;
