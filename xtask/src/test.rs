//! `cargo xtask test`: all the tests, and what they need.

use std::{env, path::PathBuf, process::Command};

use crate::system::{Options, built_example, cargo, cargo_program, install_packages, output, step, workspace};

/// The package of Debian and Ubuntu that holds Mesa's software Vulkan driver.
const DRIVER: &str = "mesa-vulkan-drivers";

/// Part of the path of each test that needs a graphics adapter.
const NEEDS_ADAPTER: &str = "wgpu";

/// Runs all the tests. The first group that fails ends the run.
pub fn run(options: Options) -> Result<(), String> {
    report_data();
    // All at once, which keeps all cores busy. A test of gs-backend runs `window`.
    let all = ["--lib", "--bins", "--tests", "--example", "adapters", "--example", "window"];
    cargo(&[&["build", "--locked", "--workspace"], &all[..]].concat())?;
    let adapter = find_adapter(options.install)?;
    let skip: &[&str] = if adapter { &[] } else { &["--", "--skip", NEEDS_ADAPTER] };
    if output(Command::new(cargo_program()).args(["nextest", "--version"])).is_ok() {
        // nextest runs the test programs side by side, but no documentation tests.
        cargo(&[&["nextest", "run", "--workspace", "--lib", "--bins", "--tests"], skip].concat())?;
    } else {
        cargo(&[&["test", "--workspace", "--lib", "--bins", "--tests"], skip].concat())?;
    }
    cargo(&[&["test", "--workspace", "--doc"], skip].concat())?;
    if options.slow {
        let slow = ["test", "--workspace", "--release", "--lib", "--bins", "--tests", "--", "--ignored"];
        cargo(&[&slow[..], skip.get(1..).unwrap_or_default()].concat())?;
        cargo(&["test", "-p", "gs-cli", "--features", "manual", "manual"])?;
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
    let list = output(Command::new(cargo_program()).args(arguments).current_dir(workspace()))?;
    let names: Vec<&str> = list.lines().filter_map(|line| line.strip_suffix(": test")).collect();
    names.iter().for_each(|name| eprintln!("skipped: {name}"));
    eprintln!(
        "skipped {} tests and the documentation tests of gs-wgpu: no graphics adapter; run cargo xtask test --install",
        names.len()
    );
    Ok(())
}
