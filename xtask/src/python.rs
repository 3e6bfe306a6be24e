//! `cargo xtask python`: builds the Python module, and tests it in an environment of its own.

use std::{
    env,
    ffi::OsStr,
    path::{Path, PathBuf},
    process::Command,
};

use crate::system::{
    Options, VERSION, built_module, cargo, copy, empty, entries, install_packages, output, remove, step, target,
    workspace,
};

/// What packs wheels, from PyPI.
const TOOLS: [&str; 4] = ["packaging>=24", "pyproject-metadata>=0.9,<1", "tomli>=2,<3", "wheel>=0.45,<1"];

/// The packages of Debian and Ubuntu with a Python that can make environments.
const PYTHON: [&str; 2] = ["python3", "python3-venv"];

/// Builds a wheel into `target/wheels`: for use, or without optimising what does not compute, to be
/// tested.
pub fn run(options: Options) -> Result<(), String> {
    let Some(python) = with_environments(9, options.install)? else {
        eprintln!("skipped: there is no Python 3.9 or later with the module venv: the Python module");
        return Ok(());
    };
    let target = target();
    let (environment, wheels) = (target.join("python"), target.join("wheels"));
    remove(&environment)?;
    let program = |name: &str| Command::new(programs(&environment).join(name));
    if let Err(error) = self::environment(python, &environment).and_then(|mut pip| step(pip.args(TOOLS))) {
        eprintln!("skipped: what the Python module needs cannot be installed ({error})");
        return Ok(());
    }
    let built = if options.test {
        built_module()?
    } else {
        cargo(&["build", "--locked", "--release", "-p", "gs-python"])?;
        target.join("release")
    };
    let tree = target.join("python-wheel");
    wheel_tree(&tree, &built.join(format!("{}_native{}", env::consts::DLL_PREFIX, env::consts::DLL_SUFFIX)))?;
    empty(&wheels)?;
    pack_wheel(program, &tree, None, &wheels)?;
    let wheel = entries(&wheels)?.pop().ok_or("no wheel was packed")?;
    eprintln!("built {}", wheel.display());
    if !options.test {
        return Ok(());
    }
    let module = workspace().join("gs-python");
    step(pip(&environment).arg(format!("{}[test]", wheel.display())))?;
    step(program("ruff").args(["check", "."]).current_dir(&module))?;
    step(program("ruff").args(["format", "--check", "."]).current_dir(&module))?;
    step(program("mypy").args(["--strict", "python", "tests", "examples"]).current_dir(&module))?;
    step(program("stubtest").args(STUBTEST).current_dir(&module))?;
    // Development mode shows what Python only warns of otherwise. Skipped tests are listed by name.
    let mut tests = program("python");
    tests.args(["-X", "dev", "-X", "faulthandler", "-m", "pytest", "-q", "-rs", "tests"]);
    step(tests.current_dir(&module))
}

/// Makes the folder of what a wheel consists of, in place of one that may be there, with the compiled module
/// and the licences of the project.
pub fn wheel_tree(tree: &Path, module: &Path) -> Result<(), String> {
    let windows = module.extension().is_some_and(|ending| ending == "dll");
    let name = if windows { "_native.pyd" } else { "_native.abi3.so" };
    empty(tree)?;
    copy(module, &tree.join("gaussian_splats").join(name))?;
    for file in ["LICENSE-APACHE", "LICENSE-MIT"] {
        copy(&workspace().join(file), &wheel_information(tree).join("licenses").join(file))?;
    }
    Ok(())
}

/// The folder of a wheel's tree for metadata.
pub fn wheel_information(tree: &Path) -> PathBuf {
    tree.join(format!("gaussian_splats-{VERSION}.dist-info"))
}

/// Adds the Python sources and the metadata to a wheel's tree, and packs it into a folder. The programs are
/// those of an environment with `TOOLS`; the platform is that of its Python if none is given.
pub fn pack_wheel(
    program: impl Fn(&str) -> Command,
    tree: &Path,
    platform: Option<&str>,
    out: &Path,
) -> Result<(), String> {
    let script = "xtask/src/python/wheel_tree.py";
    step(program("python").arg(script).arg(tree).arg(VERSION).args(platform).current_dir(workspace()))?;
    step(program("wheel").arg("pack").arg("--dest-dir").arg(out).arg(tree))
}

/// The comparison of the stub with the compiled module. What has documentation in the stub is found
/// by the build, which takes it from there.
const STUBTEST: [&str; 4] =
    ["gaussian_splats._native", "--ignore-missing-stub", "--mypy-config-file", "pyproject.toml"];

/// The folder of an environment's programs.
pub fn programs(environment: &Path) -> PathBuf {
    environment.join(if cfg!(windows) { "Scripts" } else { "bin" })
}

/// Makes an environment, and returns its `pip install`, to be given the packages.
pub fn environment(python: impl AsRef<OsStr>, folder: &Path) -> Result<Command, String> {
    step(Command::new(python).args(["-m", "venv"]).arg(folder))?;
    Ok(pip(folder))
}

fn pip(environment: &Path) -> Command {
    let mut pip = Command::new(programs(environment).join("python"));
    pip.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--retries", "2"]);
    pip
}

/// The name of a Python 3 of at least a minor version that can make environments.
pub fn with_environments(minor: u32, install: bool) -> Result<Option<&'static str>, String> {
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
