//! `cargo xtask test`: all the tests, and what they need.

use std::{
    env,
    ffi::OsString,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

/// The package of Debian and Ubuntu that holds Mesa's software Vulkan driver.
const DRIVER: &str = "mesa-vulkan-drivers";

/// Part of the path of each test that needs a graphics adapter.
const NEEDS_ADAPTER: &str = "wgpu";

/// What the command line asks for.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Options {
    /// Install what the tests need.
    install: bool,
    /// Also run the tests marked `#[ignore]`, in the release profile.
    slow: bool,
}

impl Options {
    /// Reads the flags after `test`.
    pub(crate) fn parse(flags: &[&str]) -> Result<Self, String> {
        let mut options = Self::default();
        for flag in flags {
            match *flag {
                "--install" => options.install = true,
                "--slow" => options.slow = true,
                other => return Err(format!("unknown flag {other}")),
            }
        }
        Ok(options)
    }
}

/// Runs all the tests. The first group that fails ends the run.
pub(crate) fn run(options: Options) -> Result<(), String> {
    report_data();
    let adapter = find_adapter(options.install)?;
    let skip: &[&str] = if adapter { &[] } else { &["--", "--skip", NEEDS_ADAPTER] };
    if has_nextest() {
        // nextest runs the test programs side by side, but no documentation tests.
        cargo(&[&["nextest", "run", "--workspace", "--lib", "--bins", "--tests"], skip].concat())?;
    } else {
        cargo(&[&["test", "--workspace", "--lib", "--bins", "--tests"], skip].concat())?;
    }
    cargo(&[&["test", "--workspace", "--doc"], skip].concat())?;
    if options.slow {
        let slow = ["test", "--workspace", "--release", "--lib", "--bins", "--tests", "--", "--ignored"];
        cargo(&[&slow[..], skip.get(1..).unwrap_or_default()].concat())?;
    }
    if adapter { Ok(()) } else { report_skipped() }
}

/// Says which folder of real images and scenes the tests read.
fn report_data() {
    // The same rule as gs_conformance::data, which this program cannot depend on.
    let data = env::var_os("GS_DATA").map_or_else(|| workspace().join("../shared/data"), PathBuf::from);
    if data.is_dir() {
        eprintln!("real test data: {}", data.display());
    } else {
        eprintln!("real test data: none at {}; set GS_DATA to a folder that has some", data.display());
    }
}

/// Whether there is a graphics adapter, if necessary after installing a software one.
fn find_adapter(install: bool) -> Result<bool, String> {
    let found = || cargo(&["run", "--quiet", "--package", "gs-wgpu", "--example", "adapters"]).is_ok();
    if found() {
        return Ok(true);
    }
    if !install {
        eprintln!("no graphics adapter: skipping the tests that need one");
        return Ok(false);
    }
    eprintln!("no graphics adapter: installing {DRIVER}, Mesa's software Vulkan driver");
    install_package(DRIVER).map_err(|error| {
        format!("{error}: install Mesa's software Vulkan driver or a GPU's driver by hand, or run without --install")
    })?;
    if found() { Ok(true) } else { Err(format!("{DRIVER} is installed, but there is still no graphics adapter")) }
}

/// Lists the tests that [`run`] skipped because there is no adapter.
fn report_skipped() -> Result<(), String> {
    let arguments = ["test", "--quiet", "--workspace", "--lib", "--bins", "--tests", "--", "--list", NEEDS_ADAPTER];
    let output = Command::new(cargo_program())
        .args(arguments)
        .current_dir(workspace())
        .stderr(Stdio::inherit())
        .output()
        .map_err(|error| format!("cargo could not be started: {error}"))?;
    if !output.status.success() {
        return Err(format!("cargo {}: {}", arguments.join(" "), output.status));
    }
    let list = String::from_utf8_lossy(&output.stdout);
    let names: Vec<&str> = list.lines().filter_map(|line| line.strip_suffix(": test")).collect();
    names.iter().for_each(|name| eprintln!("skipped: {name}"));
    eprintln!(
        "skipped {} tests and the documentation tests of gs-wgpu: no graphics adapter; run cargo xtask test --install",
        names.len()
    );
    Ok(())
}

/// Installs a package of the system, as root or through sudo.
fn install_package(package: &str) -> Result<(), String> {
    let is_root = Command::new("id").arg("-u").output().is_ok_and(|output| output.stdout.trim_ascii() == b"0");
    let apt = |arguments: &[&str]| {
        let mut words = if is_root { vec![] } else { vec!["sudo"] };
        words.extend(["apt-get", "--quiet", "--yes"]);
        words.extend(arguments);
        let line = words.join(" ");
        eprintln!("== {line}");
        let status = Command::new(words[0]).args(&words[1..]).env("DEBIAN_FRONTEND", "noninteractive").status();
        match status {
            Ok(status) if status.success() => Ok(()),
            Ok(status) => Err(format!("{line}: {status}")),
            Err(error) => Err(format!("{} could not be started: {error}", words[0])),
        }
    };
    // Package lists may be old, or absent as in a fresh container.
    apt(&["install", package]).or_else(|_| apt(&["update"]).and_then(|()| apt(&["install", package])))
}

/// Whether cargo has nextest.
fn has_nextest() -> bool {
    let mut version = Command::new(cargo_program());
    version.args(["nextest", "--version"]).stdout(Stdio::null()).stderr(Stdio::null());
    version.status().is_ok_and(|status| status.success())
}

/// Runs cargo in the workspace, under a line that shows the command.
fn cargo(arguments: &[&str]) -> Result<(), String> {
    let line = format!("cargo {}", arguments.join(" "));
    eprintln!("== {line}");
    let status = Command::new(cargo_program())
        .args(arguments)
        .current_dir(workspace())
        .status()
        .map_err(|error| format!("{line}: could not be started: {error}"))?;
    if status.success() { Ok(()) } else { Err(format!("{line}: {status}")) }
}

/// The cargo that runs this program, so that both use one toolchain.
fn cargo_program() -> OsString {
    env::var_os("CARGO").unwrap_or_else(|| "cargo".into())
}

fn workspace() -> PathBuf {
    let manifest = env::var_os("CARGO_MANIFEST_DIR").map_or_else(|| env!("CARGO_MANIFEST_DIR").into(), PathBuf::from);
    manifest.parent().map_or_else(|| ".".into(), Path::to_path_buf)
}
