//! `cargo xtask test`: all the tests, and what they need.

use std::{
    env,
    ffi::OsString,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

/// How much is run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Scope {
    /// Every test but those marked `#[ignore]`.
    Ordinary,
    /// The ordinary ones, then the ignored ones in the release profile.
    AlsoSlow,
}

/// Runs all the tests; the first group that fails ends the run.
pub(crate) fn run(scope: Scope) -> Result<(), String> {
    prepare()?;
    if has_nextest() {
        // nextest runs the test programs side by side, but no documentation tests.
        cargo(&["nextest", "run", "--workspace"])?;
        cargo(&["test", "--workspace", "--doc"])?;
    } else {
        cargo(&["test", "--workspace"])?;
    }
    if scope == Scope::AlsoSlow {
        cargo(&["test", "--workspace", "--release", "--lib", "--bins", "--tests", "--", "--ignored"])?;
    }
    Ok(())
}

/// Everything the tests need beyond cargo is installed or reported here, before the first of them runs.
///
/// gs-wgpu's tests need a graphics adapter: where there is none, a software Vulkan driver is installed. Tests on real photographs use a
/// folder that may be absent; whether they have it is said, so that no one takes a skipped test for a passed one.
pub(crate) fn prepare() -> Result<(), String> {
    // The rule of gs_conformance::data; this program builds before everything else, and so depends on nothing.
    let data = env::var_os("GS_DATA").map_or_else(|| workspace().join("../shared/data"), PathBuf::from);
    if data.is_dir() {
        eprintln!("real test data: {}", data.display());
    } else {
        eprintln!("real test data: none at {}; set GS_DATA to a folder that has some", data.display());
    }
    let has_adapter = || cargo(&["run", "--quiet", "--package", "gs-wgpu", "--example", "adapters"]);
    if has_adapter().is_ok() {
        return Ok(());
    }
    eprintln!("no graphics adapter: installing a software one");
    install(DRIVER)
        .map_err(|e| format!("{e}; gs-wgpu's tests need a graphics adapter: install {DRIVER}, or a GPU's driver"))?;
    has_adapter().map_err(|_| format!("{DRIVER} is installed, but still no graphics adapter is found"))
}

/// Debian's and Ubuntu's package with Mesa's software Vulkan driver.
const DRIVER: &str = "mesa-vulkan-drivers";

/// Installs a package of the system, as root or through sudo.
fn install(package: &str) -> Result<(), String> {
    let is_root = Command::new("id").arg("-u").output().is_ok_and(|output| output.stdout.trim_ascii() == b"0");
    let apt = |arguments: &[&str]| {
        let mut words = if is_root { vec![] } else { vec!["sudo"] };
        words.extend(["apt-get", "--quiet", "--yes"]);
        words.extend(arguments);
        eprintln!("== {}", words.join(" "));
        let status = Command::new(words[0]).args(&words[1..]).env("DEBIAN_FRONTEND", "noninteractive").status();
        match status {
            Ok(status) if status.success() => Ok(()),
            Ok(status) => Err(format!("{}: {status}", words.join(" "))),
            Err(source) => Err(format!("{} could not be started: {source}", words[0])),
        }
    };
    // Package lists may be old, or absent as in a fresh container.
    apt(&["install", package]).or_else(|_| apt(&["update"]).and_then(|()| apt(&["install", package])))
}

/// Whether cargo has nextest, which runs each test in a process of its own, several at a time.
pub(crate) fn has_nextest() -> bool {
    let mut version = Command::new(cargo_program());
    version.args(["nextest", "--version"]).stdout(Stdio::null()).stderr(Stdio::null());
    version.status().is_ok_and(|status| status.success())
}

fn cargo(arguments: &[&str]) -> Result<(), String> {
    cargo_with(arguments, |cargo| cargo)
}

/// Runs cargo in the workspace, with what `prepare` adds.
pub(crate) fn cargo_with(arguments: &[&str], prepare: impl FnOnce(&mut Command) -> &mut Command) -> Result<(), String> {
    let mut cargo = Command::new(cargo_program());
    run_in_workspace(&format!("cargo {}", arguments.join(" ")), prepare(cargo.args(arguments)))
}

/// Runs a command in the workspace, under the line that says what it is.
pub(crate) fn run_in_workspace(line: &str, command: &mut Command) -> Result<(), String> {
    eprintln!("== {line}");
    let status = command
        .current_dir(workspace())
        .status()
        .map_err(|source| format!("{line}: could not be started: {source}"))?;
    if status.success() { Ok(()) } else { Err(format!("{line}: {status}")) }
}

/// The cargo that runs this program, so that both use one toolchain.
pub(crate) fn cargo_program() -> OsString {
    env::var_os("CARGO").unwrap_or_else(|| "cargo".into())
}

pub(crate) fn workspace() -> PathBuf {
    let manifest = env::var_os("CARGO_MANIFEST_DIR").map_or_else(|| env!("CARGO_MANIFEST_DIR").into(), PathBuf::from);
    manifest.parent().map_or_else(|| ".".into(), Path::to_path_buf)
}
