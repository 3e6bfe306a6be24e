//! What the fuzz targets do: the same as the test of their corpus, `gs-io/tests/fuzzed`.

#[path = "../../gs-io/tests/fuzzed/targets.rs"]
pub mod targets;
