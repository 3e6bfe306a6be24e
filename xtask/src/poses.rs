//! `cargo xtask poses`: finds the poses of real photographs with COLMAP.

use std::process::Command;

use crate::system::{Options, cargo, install_packages};

/// The test that runs COLMAP, and the one of how it compares.
const TESTS: &str = "poses_real::";

/// Installs COLMAP, shows its version, and runs the tests, as far as that is asked for.
pub(crate) fn run(options: Options) -> Result<(), String> {
    if options.install && version().is_none() {
        install_packages(&["colmap"])?;
    }
    let Some(version) = version() else {
        eprintln!("skipped: COLMAP is not installed, which --install does");
        return Ok(());
    };
    eprintln!("{version}");
    if !options.test {
        return Ok(());
    }
    let test = ["test", "--release", "--package", "gs-cli", "--test", "program", TESTS];
    cargo(&[&test[..], &["--", "--include-ignored", "--nocapture"]].concat())
}

/// The first line of COLMAP's help; `None` without COLMAP.
fn version() -> Option<String> {
    let output = Command::new("colmap").arg("help").output().ok()?;
    String::from_utf8_lossy(&output.stdout).lines().next().map(str::to_owned)
}
