//! `cargo xtask poses`: finds the poses of real photographs with COLMAP.

use std::{path::PathBuf, process::Command};

use crate::{
    python,
    system::{Options, cargo_program, install_packages, output, step, target, workspace},
};

/// The test that runs COLMAP, and the one of how it compares.
const TESTS: &str = "poses_found::";

/// The oldest PyCOLMAP that gs-poses runs, from PyPI.
const PYCOLMAP: &str = "pycolmap>=4.1.1";

/// Installs COLMAP and PyCOLMAP, shows the version, and runs the tests, as far as that is asked for.
pub fn run(options: Options) -> Result<(), String> {
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
    let mut test = Command::new(cargo_program());
    test.args(["test", "--release", "--package", "gs-cli", "--test", "program", TESTS]);
    test.args(["--", "--include-ignored", "--nocapture"]).current_dir(workspace());
    match pycolmap(options.install) {
        Ok(python) => _ = test.env("GS_PYTHON", python),
        Err(error) => eprintln!("skipped: there is no PyCOLMAP ({error})"),
    }
    step(&mut test)
}

/// The Python of an environment with PyCOLMAP, which is made if that is asked for.
fn pycolmap(install: bool) -> Result<PathBuf, String> {
    let environment = target().join("pycolmap");
    let python = environment.join("bin/python");
    if install {
        let system = python::with_environments(9, true)?.ok_or("no Python 3.9 or later with the module venv")?;
        step(python::environment(system, &environment)?.arg(PYCOLMAP))?;
    }
    if python.exists() { Ok(python) } else { Err("--install makes it".to_owned()) }
}

/// The first line of COLMAP's help; `None` without COLMAP.
fn version() -> Option<String> {
    output(Command::new("colmap").arg("help")).ok()?.lines().next().map(str::to_owned)
}
