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

/// What help says about the page.
pub(crate) const HELP: &str = "\
The viewer in the browser is built once, by cargo xtask web --install in the folder of gs's sources. That \
also puts it where a gs of cargo install finds it, in ~/.cargo/share/gs/page. gs looks for it in page, \
../page and ../share/gs/page next to itself, unless GS_PAGE names its folder.";

/// The folder of the page's files: the one that the variable names, or one next to the program.
pub(crate) fn folder() -> Result<PathBuf, Failure> {
    let named = env::var_os(VARIABLE).filter(|value| !value.is_empty()).map(PathBuf::from);
    let program = env::current_exe().map_err(|error| Failure::failed(format_args!("the program's path: {error}")))?;
    folder_for(named, &program)
}

/// `target/release/gs` finds `target/page`, and `~/.cargo/bin/gs` finds `~/.cargo/share/gs/page`.
fn folder_for(named: Option<PathBuf>, program: &Path) -> Result<PathBuf, Failure> {
    let places = named.map_or_else(|| next_to(program), |folder| vec![folder]);
    if let Some(place) = places.iter().find(|place| place.join(ONE_FILE).is_file()) {
        return Ok(place.clone());
    }
    let places: Vec<String> = places.iter().map(|place| place.display().to_string()).collect();
    let message = format!("there is no page for browsers in {}", places.join(" or "));
    Err(Failure::failed(message).hint(format_args!(
        "build it with cargo xtask web --install in the folder of gs's sources, or name its folder in {VARIABLE}"
    )))
}

/// The places where the page is looked for.
fn next_to(program: &Path) -> Vec<PathBuf> {
    let beside = program.parent().unwrap_or(Path::new("."));
    let above = beside.parent().unwrap_or(beside);
    vec![beside.join("page"), above.join("page"), above.join("share").join("gs").join("page")]
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn the_page_is_found_where_it_is_built_and_where_it_is_installed() {
        let place = tempfile::tempdir().unwrap();
        for (program, page) in [
            ("unpacked/gs", "unpacked/page"),
            ("target/release/gs", "target/page"),
            (".cargo/bin/gs", ".cargo/share/gs/page"),
        ] {
            let [program, page] = [program, page].map(|path| place.path().join(path));
            folder_for(None, &program).unwrap_err();
            fs::create_dir_all(&page).unwrap();
            fs::write(page.join(ONE_FILE), "").unwrap();
            assert_eq!(folder_for(None, &program).unwrap(), page);
            assert_eq!(folder_for(Some(page.clone()), Path::new("gs")).unwrap(), page);
        }
    }

    #[test]
    fn a_missing_page_is_reported_with_the_command_that_builds_it() {
        let line = |named: Option<&str>| {
            let missing = folder_for(named.map(PathBuf::from), Path::new("/x/release/gs")).unwrap_err();
            missing.line().unwrap().replace('\\', "/")
        };
        assert_eq!(
            line(None),
            "error: there is no page for browsers in /x/release/page or /x/page or /x/share/gs/page: build it with \
             cargo xtask web --install in the folder of gs's sources, or name its folder in GS_PAGE"
        );
        assert!(line(Some("/elsewhere")).contains("no page for browsers in /elsewhere: build"));
    }
}
