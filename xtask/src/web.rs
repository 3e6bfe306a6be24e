//! `cargo xtask web`: builds the page and the npm package, and tests them in a browser.

mod package;

use std::{
    env, fs, io,
    path::{Path, PathBuf},
    process::Command,
    thread,
};

use crate::system::{
    Options, at, built_program, cargo_program, has_program, install_packages, need_target, remapped_paths, remove,
    rustc, step, target, workspace,
};

use package::package_folder;
pub use package::{archive, need_npm, package, test_package};

/// The target of the page.
pub const TARGET: &str = "wasm32-unknown-unknown";

/// The component of Rust with the sources of the standard library, which threads need.
const STD_SOURCES: &str = "rust-src";

/// The instructions that the page uses beyond those of the target. Browsers have had them since 2023.
const RUSTFLAGS: &str = "-C target-feature=+simd128";

/// What threads take beyond [`RUSTFLAGS`]: instructions, a memory that is shared and comes from outside, of
/// 4 GiB at most, and the symbols by which wasm-bindgen gives each thread its own data.
const THREADS_RUSTFLAGS: &str = "-C target-feature=+simd128,+atomics,+bulk-memory,+mutable-globals \
     -C link-arg=--shared-memory -C link-arg=--import-memory -C link-arg=--max-memory=4294967296 \
     -C link-arg=--export=__heap_base -C link-arg=--export=__wasm_init_tls \
     -C link-arg=--export=__tls_size -C link-arg=--export=__tls_align -C link-arg=--export=__tls_base";

/// The names of browsers that can be driven.
const BROWSERS: [&str; 3] = ["chromium", "chromium-browser", "google-chrome"];

/// What drives a browser, as Debian's packages.
const PACKAGES: [&str; 3] = ["chromium", "nodejs", "npm"];

/// Builds the page into `target/page`, or tests one that was built without optimising what does not
/// compute, which takes half the time; or builds the npm package into `target/web-package`.
///
/// Only with `--slow`, the page under test has a WebAssembly of its own for one thread, as the page of a
/// release has. Otherwise that for several threads stands in for it, in one thread: Chromium allows its
/// shared memory on every page, Safari on isolated ones alone.
pub fn run(options: Options) -> Result<(), String> {
    let target = target();
    if options.install {
        install(options.test || options.package)?;
    }
    need_target(TARGET, options.install)?;
    check_versions()?;
    if options.package {
        // Only a release, which adds the licences of all parts, goes into `target/dist`.
        let archive = package(&package_folder(), |_| Ok(()))?;
        return if options.test { test_package(&archive, built_program, options.install).map(drop) } else { Ok(()) };
    }
    if options.test {
        return test(&target, options);
    }
    let page = built_page()?;
    match installed_page().filter(|_| options.install) {
        Some(installed) => copy_folder(&page, &installed),
        None => Ok(()),
    }
}

/// Builds the page into `target/page`, and returns the folder.
pub fn built_page() -> Result<PathBuf, String> {
    let page = target().join("page");
    build(&target(), "web", "release", &page, false)?;
    eprintln!("built {}", page.display());
    Ok(page)
}

/// Where a `gs` that `cargo install` made looks for the page.
fn installed_page() -> Option<PathBuf> {
    let from = |name: &str| env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let root = from("CARGO_INSTALL_ROOT").or_else(|| from("CARGO_HOME"));
    Some(root.or_else(|| Some(env::home_dir()?.join(".cargo")))?.join("share").join("gs").join("page"))
}

/// Replaces a folder by a copy of another one.
pub fn copy_folder(from: &Path, to: &Path) -> Result<(), String> {
    fn copy(from: &Path, to: &Path) -> io::Result<()> {
        fs::create_dir_all(to)?;
        for entry in fs::read_dir(from)? {
            let name = entry?.file_name();
            let (source, copied) = (from.join(&name), to.join(&name));
            if source.is_dir() { copy(&source, &copied)? } else { fs::copy(&source, &copied).map(drop)? }
        }
        Ok(())
    }
    remove(to)?;
    copy(from, to).map_err(at(to))?;
    eprintln!("copied to {}", to.display());
    Ok(())
}

/// Builds the page with a profile of the workspace, by a tool that is built with a profile of its own. With
/// `threads_alone`, one WebAssembly is built where threads are possible, instead of two.
fn build(target: &Path, profile: &str, tool_profile: &str, page: &Path, threads_alone: bool) -> Result<(), String> {
    let threaded = has_std_sources().then(|| compile_threaded(target, profile)).transpose()?;
    if threaded.is_none() {
        eprintln!("skipped: threads: rustup component add {STD_SOURCES}, or --install; the page has one thread");
    }
    let wasm = match &threaded {
        Some(threaded) if threads_alone => threaded.clone(),
        _ => compile(target, profile, RUSTFLAGS, |wasm| wasm)?,
    };
    step(tool(target, tool_profile).arg(wasm).arg("gs-web/page").arg(page).args(threaded))
}

/// The tool that makes bindings and the page, built with a profile of its own; to be given its arguments.
fn tool(target: &Path, profile: &str) -> Command {
    let mut tool = Command::new(cargo_program());
    tool.args(["run", "--quiet", "--locked", "--profile", profile, "--manifest-path", "gs-web/tool/Cargo.toml"]);
    tool.arg("--target-dir").arg(target.join("web-tool")).arg("--").current_dir(workspace());
    tool
}

/// Builds the WebAssembly, and returns its path.
fn compile(
    target: &Path,
    profile: &str,
    flags: &str,
    with: impl FnOnce(&mut Command) -> &mut Command,
) -> Result<PathBuf, String> {
    let mut wasm = Command::new(cargo_program());
    let flags: Vec<String> = flags.split_whitespace().map(str::to_owned).chain(remapped_paths()).collect();
    wasm.env("CARGO_ENCODED_RUSTFLAGS", flags.join("\x1f"));
    wasm.args(["build", "--locked", "-p", "gs-web", "--profile", profile, "--target", TARGET]);
    step(with(&mut wasm).arg("--target-dir").arg(target).current_dir(workspace()))?;
    let folder = if profile == "dev" { "debug" } else { profile };
    Ok(target.join(TARGET).join(folder).join("gs_web.wasm"))
}

/// Builds the WebAssembly for several threads, together with a standard library that has them.
///
/// A stable compiler does so only with `RUSTC_BOOTSTRAP`. Build scripts look at that, too: in the folder
/// of other builds, each would compile again what the one before it has compiled.
fn compile_threaded(target: &Path, profile: &str) -> Result<PathBuf, String> {
    compile(&target.join("web-threads"), profile, THREADS_RUSTFLAGS, |wasm| {
        wasm.args(["-Z", "build-std=std,panic_abort"]).env("RUSTC_BOOTSTRAP", "1")
    })
}

/// Whether the sources of the standard library are there.
fn has_std_sources() -> bool {
    Path::new(&rustc(&["--print", "sysroot"])).join("lib/rustlib/src/rust/library/std").is_dir()
}

/// Checks that the page can have threads, or installs what they need.
pub fn need_std_sources(install: bool) -> Result<(), String> {
    match (has_std_sources(), install) {
        (true, _) => Ok(()),
        (false, true) => install_std_sources(),
        (false, false) => Err(format!("the page has no threads: rustup component add {STD_SOURCES}, or --install")),
    }
}

fn install_std_sources() -> Result<(), String> {
    step(Command::new("rustup").args(["component", "add", STD_SOURCES]))
}

/// Installs what the page and the package are built with, and what tests them.
pub fn install(for_test: bool) -> Result<(), String> {
    install_std_sources()?;
    // Node and the browser may be others than Debian's.
    let is_there = |name: &&str| match *name {
        "chromium" => BROWSERS.into_iter().any(has_program),
        "nodejs" => has_program("node"),
        name => has_program(name),
    };
    let missing: Vec<&str> = PACKAGES.into_iter().filter(|name| !is_there(name)).collect();
    if for_test && !missing.is_empty() { install_packages(&missing) } else { Ok(()) }
}

/// The tool that makes the bindings must be of the version that the page is compiled with.
fn check_versions() -> Result<(), String> {
    let version = |file: &str, package: &str| {
        let text = fs::read_to_string(workspace().join(file)).map_err(|error| format!("{file}: {error}"))?;
        let entry = text.split("[[package]]").find(|entry| entry.contains(&format!("name = \"{package}\"\n")));
        let line = entry.and_then(|entry| entry.lines().find_map(|line| line.strip_prefix("version = ")));
        line.map(str::to_owned).ok_or_else(|| format!("{file} has no {package}"))
    };
    let page = version("Cargo.lock", "wasm-bindgen")?;
    let tool = version("gs-web/tool/Cargo.lock", "wasm-bindgen-cli-support")?;
    if page == tool {
        return Ok(());
    }
    Err(format!("wasm-bindgen is {page} in Cargo.lock, but {tool} in gs-web/tool/Cargo.lock: make them equal"))
}

/// What drives a browser in tests.
struct Driver {
    browser: &'static str,
    /// The folder with the packages of npm, where files and screenshots are kept.
    place: PathBuf,
}

impl Driver {
    /// Finds what `what` is tested with; says what is skipped if it isn't there.
    fn found(what: &str, install: bool) -> Result<Option<Self>, String> {
        let browser = BROWSERS.into_iter().find(|name| has_program(name));
        let Some(browser) = browser.filter(|_| has_program("node") && has_program("npm")) else {
            eprintln!("skipped: {what}: node, npm and chromium are needed; --install installs them");
            return Ok(None);
        };
        let place = target().join("web-test");
        if install {
            install_packages_of_npm(&workspace().join("gs-web/tests"), &place)?;
        }
        if !place.join("node_modules/puppeteer-core").exists() {
            eprintln!("skipped: {what}: the tests' packages of npm aren't there; --install installs them");
            return Ok(None);
        }
        Ok(Some(Self { browser, place }))
    }
}

/// Installs the packages that a folder's `package-lock.json` names into another folder.
fn install_packages_of_npm(from: &Path, to: &Path) -> Result<(), String> {
    fs::create_dir_all(to).map_err(at(to))?;
    for file in ["package.json", "package-lock.json"] {
        fs::copy(from.join(file), to.join(file)).map_err(|error| format!("{file}: {error}"))?;
    }
    step(Command::new("npm").args(["ci", "--ignore-scripts", "--no-audit", "--no-fund"]).current_dir(to))
}

/// Runs the tests in a browser.
fn test(target: &Path, options: Options) -> Result<(), String> {
    let driver = Driver::found("the page in a browser", options.install)?;
    let Some(Driver { browser, place }) = driver else { return Ok(()) };
    let (page, tests) = (place.join("page"), workspace().join("gs-web/tests"));
    build(target, "dev", "dev", &page, !options.slow)?;
    let gs = built_program()?;
    step(Command::new("node").arg(tests.join("sog.mjs")).arg(&gs).arg(&place))?;
    // Most of the tests compute in one thread: two processes use two cores.
    let halves = ["fit,threads", "view,trouble,serve"].map(|parts| {
        let mut node = Command::new("node");
        node.arg(tests.join("page.mjs")).arg(browser).args([&page, &gs, &place]).arg(parts).env("GS_PAGE", &page);
        thread::spawn(move || step(&mut node))
    });
    let ended = halves.map(|half| half.join().map_err(|_| "a test process could not be watched".to_owned()).flatten());
    ended.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_installed_page_is_replaced_with_its_folders() {
        let place = env::temp_dir().join(format!("gs-xtask-page-{}", std::process::id()));
        let [built, installed] = ["built", "share/gs/page"].map(|folder| place.join(folder));
        fs::create_dir_all(built.join("threads")).unwrap();
        fs::create_dir_all(&installed).unwrap();
        fs::write(built.join("threads/worker.js"), "new").unwrap();
        fs::write(installed.join("old.js"), "old").unwrap();
        copy_folder(&built, &installed).unwrap();
        assert_eq!(fs::read_to_string(installed.join("threads/worker.js")).unwrap(), "new");
        assert!(!installed.join("old.js").exists());
        fs::remove_dir_all(&place).unwrap();
    }
}
