//! `cargo xtask test`: all the tests, and what they need.

use std::{
    env,
    path::PathBuf,
    process::{Command, Stdio},
};

use crate::system::{built_example, cargo, cargo_program, install_packages, step, workspace};

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
    // A test of gs-backend runs it.
    built_example("window")?;
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
    let adapters = built_example("adapters")?;
    let found = || step(&mut Command::new(&adapters)).is_ok();
    if found() {
        return Ok(true);
    }
    if !install {
        eprintln!("no graphics adapter: skipping the tests that need one");
        return Ok(false);
    }
    eprintln!("no graphics adapter: installing {DRIVER}, Mesa's software Vulkan driver");
    install_packages(&[DRIVER]).map_err(|error| {
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

/// Whether cargo has nextest.
fn has_nextest() -> bool {
    let mut version = Command::new(cargo_program());
    version.args(["nextest", "--version"]).stdout(Stdio::null()).stderr(Stdio::null());
    version.status().is_ok_and(|status| status.success())
}
