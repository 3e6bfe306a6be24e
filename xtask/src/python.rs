//! `cargo xtask python`: builds the Python module, and tests it in an environment of its own.

use std::{
    fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

use crate::system::{Options, cargo_program, install_packages, step, target, workspace};

/// What builds wheels, from PyPI.
const MATURIN: &str = "maturin>=1.9,<2";

/// The packages of Debian and Ubuntu with a Python that can make environments.
const PYTHON: [&str; 2] = ["python3", "python3-venv"];

/// Builds a wheel into `target/wheels`: for use, or without optimising what does not compute, to be
/// tested.
pub(crate) fn run(options: Options) -> Result<(), String> {
    let Some(python) = with_environments(9, options.install)? else {
        eprintln!("skipped: there is no Python 3.9 or later with the module venv: the Python module");
        return Ok(());
    };
    let target = target();
    let (environment, wheels) = (target.join("python"), target.join("wheels"));
    remove(&environment)?;
    step(Command::new(python).args(["-m", "venv"]).arg(&environment))?;
    let program = |name: &str| environment.join("bin").join(name);
    let install = |what: &str| {
        let mut pip = Command::new(program("pip"));
        step(pip.args(["install", "--quiet", "--disable-pip-version-check", "--retries", "2", what]))
    };
    if let Err(error) = install(MATURIN) {
        eprintln!("skipped: what the Python module needs cannot be installed ({error})");
        return Ok(());
    }
    let module = workspace().join("gs-python");
    let profile = if options.test { "dev" } else { "release" };
    remove(&wheels)?;
    let mut build = Command::new(program("maturin"));
    build.args(["build", "--locked", "--profile", profile, "--out"]).arg(&wheels).env("CARGO", cargo_program());
    step(build.current_dir(&module))?;
    let wheel = wheel_in(&wheels)?;
    eprintln!("built {}", wheel.display());
    if !options.test {
        return Ok(());
    }
    install(&format!("{}[test]", wheel.display()))?;
    step(Command::new(program("ruff")).args(["check", "."]).current_dir(&module))?;
    step(Command::new(program("ruff")).args(["format", "--check", "."]).current_dir(&module))?;
    step(Command::new(program("mypy")).args(["--strict", "python", "tests", "examples"]).current_dir(&module))?;
    step(Command::new(program("stubtest")).args(STUBTEST).current_dir(&module))?;
    // Development mode shows what Python only warns of otherwise. Skipped tests are listed by name.
    let mut tests = Command::new(program("python"));
    tests.args(["-X", "dev", "-X", "faulthandler", "-m", "pytest", "-q", "-rs", "tests"]);
    step(tests.current_dir(&module))
}

/// The comparison of the stub with the compiled module. What has documentation in the stub is found
/// by the build, which takes it from there.
const STUBTEST: [&str; 4] =
    ["gaussian_splats._native", "--ignore-missing-stub", "--mypy-config-file", "pyproject.toml"];

/// The name of a Python 3 of at least a minor version that can make environments.
pub(crate) fn with_environments(minor: u32, install: bool) -> Result<Option<&'static str>, String> {
    let found = || ["python3", "python"].into_iter().find(|program| has_venv(program, minor));
    if found().is_none() && install {
        install_packages(&PYTHON)?;
    }
    Ok(found())
}

/// Whether this is a Python that can make an environment.
fn has_venv(program: &str, minor: u32) -> bool {
    let check = format!("import sys, venv, ensurepip; sys.exit(sys.version_info < (3, {minor}))");
    let status = Command::new(program).args(["-c", &check]).stdout(Stdio::null()).stderr(Stdio::null()).status();
    status.is_ok_and(|status| status.success())
}

/// Removes a folder of an earlier run.
fn remove(folder: &Path) -> Result<(), String> {
    match folder.exists() {
        true => fs::remove_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display())),
        false => Ok(()),
    }
}

fn wheel_in(folder: &Path) -> Result<PathBuf, String> {
    let files = fs::read_dir(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let mut files = files.flatten().map(|entry| entry.path());
    files
        .find(|path| path.extension().is_some_and(|ending| ending == "whl"))
        .ok_or_else(|| format!("{}: there is no wheel", folder.display()))
}
