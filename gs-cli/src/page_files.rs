//! The page for browsers, which `cargo xtask web` builds: where its files are.

use std::{
    env,
    path::{Path, PathBuf},
};

use crate::failure::Failure;

/// The environment variable that names the folder.
const VARIABLE: &str = "GS_PAGE";

/// The whole page as a single file.
pub(crate) const ONE_FILE: &str = "one-file.html";

/// The folder of the page's files: the one that the variable names, or one beside the program.
/// `target/release/gs` finds `target/page`.
pub(crate) fn folder() -> Result<PathBuf, Failure> {
    let missing = |place: String| {
        let message = format!("there is no page for browsers in {place}");
        Failure::failed(message).hint(format_args!("build it with cargo xtask web, or name its folder in {VARIABLE}"))
    };
    if let Some(folder) = env::var_os(VARIABLE).filter(|value| !value.is_empty()).map(PathBuf::from) {
        return if has_page(&folder) { Ok(folder) } else { Err(missing(folder.display().to_string())) };
    }
    let program = env::current_exe().map_err(|error| Failure::failed(format_args!("the program's path: {error}")))?;
    let beside = program.parent().unwrap_or(Path::new("."));
    let places = ["page", "../page", "../share/gs/page"].map(|place| beside.join(place));
    places
        .into_iter()
        .find(|place| has_page(place))
        .ok_or_else(|| missing(beside.join("../page").display().to_string()))
}

fn has_page(folder: &Path) -> bool {
    folder.join(ONE_FILE).is_file()
}
