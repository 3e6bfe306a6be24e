//! `cargo xtask python`: builds the Python module, and tests it in an environment of its own.

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

use crate::system::{cargo_program, step, workspace};

/// Packages that building and testing need, from PyPI.
const PACKAGES: [&str; 6] = ["maturin>=1.9,<2", "numpy>=1.22", "pytest>=8", "mypy>=1.11", "ruff>=0.6", "tqdm>=4.60"];

/// Builds a wheel into `target/wheels`: for use, or without optimising what does not compute, to be
/// tested.
pub(crate) fn run(test: bool) -> Result<(), String> {
    let Some(python) = ["python3", "python"].into_iter().find(|program| has_venv(program)) else {
        eprintln!("skipped: there is no Python 3.9 or later with the module venv: the Python module");
        return Ok(());
    };
    let target = env::var_os("CARGO_TARGET_DIR").map_or_else(|| workspace().join("target"), PathBuf::from);
    let (environment, wheels) = (target.join("python"), target.join("wheels"));
    remove(&environment)?;
    step(Command::new(python).args(["-m", "venv"]).arg(&environment))?;
    let program = |name: &str| environment.join("bin").join(name);
    let mut install = Command::new(program("pip"));
    install.args(["install", "--quiet", "--disable-pip-version-check", "--retries", "2"]).args(PACKAGES);
    if let Err(error) = step(&mut install) {
        eprintln!("skipped: the packages that the Python module needs cannot be installed ({error})");
        return Ok(());
    }
    let module = workspace().join("gs-python");
    let profile = if test { "dev" } else { "release" };
    remove(&wheels)?;
    let mut build = Command::new(program("maturin"));
    build.args(["build", "--locked", "--profile", profile, "--out"]).arg(&wheels).env("CARGO", cargo_program());
    step(build.current_dir(&module))?;
    let wheel = wheel_in(&wheels)?;
    eprintln!("built {}", wheel.display());
    if !test {
        return Ok(());
    }
    step(Command::new(program("pip")).args(["install", "--quiet", "--no-deps"]).arg(&wheel))?;
    step(Command::new(program("ruff")).args(["check", "."]).current_dir(&module))?;
    step(Command::new(program("mypy")).args(["--strict", "python", "tests", "examples"]).current_dir(&module))?;
    // Development mode shows what Python only warns of otherwise.
    let mut tests = Command::new(program("python"));
    tests.args(["-X", "dev", "-X", "faulthandler", "-m", "pytest", "-q", "tests"]);
    step(tests.current_dir(&module))
}

/// Whether this is a Python that can make an environment.
fn has_venv(program: &str) -> bool {
    let check = "import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 9))";
    let status = Command::new(program).args(["-c", check]).stdout(Stdio::null()).stderr(Stdio::null()).status();
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
