//! Tests of readers and writers. One binary for all modules, so that the tests link once.

mod containers;
mod fuzzed;
mod gsi;
mod images;
mod scene3d;
