//! The fuzz targets. Those of readers do the same as the test of their corpus,
//! `gs-io/tests/fuzzed`; those of scenes do the same as gs-conformance's tests.

pub mod scenes;

#[path = "../../gs-io/tests/fuzzed/targets.rs"]
pub mod targets;
