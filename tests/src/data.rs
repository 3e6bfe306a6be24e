//! Optional test data, which is not part of the project: images, data sets and published scenes.

use std::path::{Path, PathBuf};

/// The folder of test data, which may not exist: `$GS_DATA`, or `../shared/data` next to the
/// workspace.
pub fn folder() -> PathBuf {
    std::env::var_os("GS_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"), PathBuf::from)
}

/// A file or folder of the test data, such as `splats/biker.spz`. Prints a line and returns `None`
/// if it is missing.
pub fn find(name: &str) -> Option<PathBuf> {
    let path = folder().join(name);
    if path.exists() {
        return Some(path);
    }
    eprintln!("skipped: no test data {}", path.display());
    None
}
