//! `cargo xtask python`: builds the Python module, and tests it in an environment of its own.

use std::{
    ffi::OsStr,
    path::{Path, PathBuf},
    process::Command,
};

use crate::system::{Options, cargo_program, entries, install_packages, output, remove, step, target, workspace};

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
    let program = |name: &str| programs(&environment).join(name);
    if let Err(error) = self::environment(python, &environment).and_then(|mut pip| step(pip.arg(MATURIN))) {
        eprintln!("skipped: what the Python module needs cannot be installed ({error})");
        return Ok(());
    }
    let module = workspace().join("gs-python");
    let profile = if options.test { "dev" } else { "release" };
    remove(&wheels)?;
    let mut build = Command::new(program("maturin"));
    build.args(["build", "--locked", "--profile", profile, "--out"]).arg(&wheels).env("CARGO", cargo_program());
    step(build.current_dir(&module))?;
    let wheel = entries(&wheels)?.pop().ok_or("maturin built no wheel")?;
    eprintln!("built {}", wheel.display());
    if !options.test {
        return Ok(());
    }
    step(pip(&environment).arg(format!("{}[test]", wheel.display())))?;
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

/// The folder of an environment's programs.
pub(crate) fn programs(environment: &Path) -> PathBuf {
    environment.join(if cfg!(windows) { "Scripts" } else { "bin" })
}

/// Makes an environment, and returns its `pip install`, to be given the packages.
pub(crate) fn environment(python: impl AsRef<OsStr>, folder: &Path) -> Result<Command, String> {
    step(Command::new(python).args(["-m", "venv"]).arg(folder))?;
    Ok(pip(folder))
}

fn pip(environment: &Path) -> Command {
    let mut pip = Command::new(programs(environment).join("python"));
    pip.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--retries", "2"]);
    pip
}

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
    output(Command::new(program).args(["-c", &check])).is_ok()
}
