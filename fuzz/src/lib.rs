//! What all fuzz targets do: hand bytes to a reader, as the tests of gs-io do with theirs (`gs-io/tests/spatial/mutations.rs`).

use std::path::Path;

use gs_core::Scene;
use gs_io::{SpatialFormat, decode_spatial};

/// Reads bytes as this kind of file. Either outcome is right, a scene whose arrays fit each other or an error of one line; a panic, or
/// memory beyond what the fuzzer allows, is a finding.
pub fn decode(format: SpatialFormat, bytes: &[u8]) {
    match decode_spatial(format, bytes, Path::new("fuzzed")) {
        Ok(file) => assert!(!matches!(file.scene.validate(), Err(gs_core::Error::Length { .. }))),
        Err(error) => assert!(!error.to_string().contains('\n')),
    }
}
