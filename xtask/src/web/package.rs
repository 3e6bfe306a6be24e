//! `cargo xtask web --package`: the npm package with the viewer and the decoder of `.gsi` files.

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::Command,
};

use super::{Driver, RUSTFLAGS, compile, install_packages_of_npm, tool};
use crate::system::{at, entries, has_program, remove, step, target, workspace};

/// The features of gs-web of which each file of WebAssembly is made, and the names of their bindings.
const PARTS: [(&str, &str); 2] = [("viewer", "gs_viewer"), ("picture", "gs_picture")];

/// Modules that the package shares with the page.
const SHARED: [&str; 6] = ["answer.js", "engine.js", "levels.js", "open-scene.js", "orbit.js", "stage.js"];

/// Where the package is put together, and what that takes.
pub(super) fn package_folder() -> PathBuf {
    target().join("web-package")
}

/// Builds the package, packs it into a folder, and returns the path of the archive. The bits do not depend on
/// when or where it is built. `complete` may add files to the folder that is packed.
pub fn package(out: &Path, complete: impl FnOnce(&Path) -> Result<(), String>) -> Result<PathBuf, String> {
    need_npm()?;
    let (target, sources) = (target(), workspace().join("gs-web/package"));
    let (tools, tree) = (package_folder(), package_folder().join("tree"));
    install_packages_of_npm(&sources.join("tools"), &tools)?;
    remove(&tree)?;
    for (feature, name) in PARTS {
        let features = ["--no-default-features", "--features", feature];
        let wasm = compile(&target, "npm", RUSTFLAGS, |build| build.args(features))?;
        let mut bind = tool(&target, "release");
        let path = env::var_os("PATH").unwrap_or_default();
        let folders = [tools.join("node_modules/.bin")].into_iter().chain(env::split_paths(&path));
        bind.env("PATH", env::join_paths(folders).map_err(|error| format!("PATH: {error}"))?);
        step(bind.arg("bind").arg(wasm).arg(&tree).arg(name))?;
        // They describe the bindings, which are no part of the package's interface.
        for ending in [".d.ts", "_bg.wasm.d.ts"] {
            let file = tree.join(format!("{name}{ending}"));
            fs::remove_file(&file).map_err(at(&file))?;
        }
    }
    copy_files(&sources, &tree, |_| true)?;
    copy_files(&workspace().join("gs-web/page"), &tree, |name| SHARED.contains(&name))?;
    copy_files(&workspace(), &tree, |name| name.starts_with("LICENSE-"))?;
    check_version(&tree)?;
    complete(&tree)?;
    fs::create_dir_all(out).map_err(at(out))?;
    let out = out.canonicalize().map_err(at(out))?;
    step(Command::new("npm").args(["pack", "--silent", "--pack-destination"]).arg(&out).current_dir(&tree))?;
    let archive = archive(&out);
    eprintln!("built {}", archive.display());
    Ok(archive)
}

/// Checks that what packs the package is there.
pub fn need_npm() -> Result<(), String> {
    let missing = ["node", "npm"].into_iter().find(|program| !has_program(program));
    missing.map_or(Ok(()), |program| Err(format!("the npm package needs {program}; --install installs it")))
}

/// Installs the package in a fresh folder, checks its types, and shows both entries in a browser, whose pictures
/// are compared with those of the program. Returns false if there is no browser.
pub fn test_package(
    archive: &Path,
    program: impl FnOnce() -> Result<PathBuf, String>,
    install: bool,
) -> Result<bool, String> {
    let Some(Driver { browser, place }) = Driver::found("the npm package", install)? else { return Ok(false) };
    let gs = program()?;
    let mut test = Command::new("node");
    test.arg(workspace().join("gs-web/tests/package.mjs")).arg(browser).arg(archive).args([&gs, &place]);
    step(test.arg(package_folder())).map(|()| true)
}

/// The archive of this version in a folder.
pub fn archive(folder: &Path) -> PathBuf {
    folder.join(format!("gaussian-splats-{}.tgz", env!("CARGO_PKG_VERSION")))
}

/// The package has the version of the workspace.
fn check_version(tree: &Path) -> Result<(), String> {
    let file = tree.join("package.json");
    let text = fs::read_to_string(&file).map_err(at(&file))?;
    let version = concat!("\"version\": \"", env!("CARGO_PKG_VERSION"), "\"");
    if text.contains(version) { Ok(()) } else { Err(format!("gs-web/package/package.json must have {version}")) }
}

/// Copies those files of a folder, but not its folders, whose names are wanted.
fn copy_files(from: &Path, to: &Path, is_wanted: impl Fn(&str) -> bool) -> Result<(), String> {
    for path in entries(from)? {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if path.is_file() && is_wanted(&name) {
            fs::copy(&path, to.join(&name)).map_err(at(&path))?;
        }
    }
    Ok(())
}
