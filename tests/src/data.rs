//! Where real test data is: photographs, data sets and scenes that others have made, which are not part of the project and may be absent.

use std::path::{Path, PathBuf};

/// The folder of test data: `$GS_DATA`, or, where that is not set, `../shared/data` beside the workspace. It may not be there.
pub fn folder() -> PathBuf {
    std::env::var_os("GS_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"), PathBuf::from)
}

/// A file or folder of the test data, such as `splats/biker.spz`; `None`, and a line that says so, where it is not there.
pub fn find(name: &str) -> Option<PathBuf> {
    let path = folder().join(name);
    if path.exists() {
        return Some(path);
    }
    eprintln!("skipped: no test data {}", path.display());
    None
}
