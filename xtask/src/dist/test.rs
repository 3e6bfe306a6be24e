//! `cargo xtask dist --test`: the release where it will run.

mod arm;
mod bare;
mod bits;
mod mac;
mod npm;
mod program;
mod sizes;
mod wheel;
mod windows;

use std::{
    env,
    path::{Path, PathBuf},
    time::Instant,
};

use super::tools::Tools;
use crate::system::{VERSION, empty, has_program, install_packages, output, target, workspace};

/// What the parts of the test share.
#[derive(Debug)]
pub(crate) struct Bench<'a> {
    tools: &'a Tools,
    /// The folder of the release.
    release: &'a Path,
    /// A photograph.
    image: PathBuf,
    /// A data set of views with their poses.
    dataset: PathBuf,
    /// The test program of gs-conformance for Arm.
    conformance: PathBuf,
    /// Install what is needed.
    install: bool,
}

/// How a part ended: what was seen, or why it did not run.
enum Outcome {
    Passed(String),
    Skipped(String),
}

/// A part of the test.
type Part = fn(&Bench<'_>) -> Result<Outcome, String>;

const PARTS: [(&str, Part); 8] = [
    ("the sizes", sizes::test),
    ("the Windows program under Wine", windows::test),
    ("the Arm program and its kernels under QEMU", arm::test),
    ("the same bits on each system", bits::test),
    ("the archive and the package on a bare Debian", bare::test),
    ("the wheels", wheel::test),
    ("the npm package", npm::test),
    ("the workspace for macOS", mac::test),
];

/// Runs all parts, and fails after the last one if any has failed, or was skipped although everything that is
/// needed was to be installed.
pub(crate) fn run(tools: &Tools, release: &Path, install: bool) -> Result<(), String> {
    let (image, dataset) = inputs(tools)?;
    // Building belongs to the release, not to what its test takes.
    let conformance = arm::built(tools)?;
    let bench = Bench { tools, release, image, dataset, conformance, install };
    let (all, mut failed) = (Instant::now(), Vec::new());
    for (name, part) in PARTS {
        let started = Instant::now();
        match part(&bench) {
            Ok(Outcome::Passed(seen)) => {
                eprintln!("passed: {name}, in {:.0} s: {seen}", started.elapsed().as_secs_f64())
            }
            Ok(Outcome::Skipped(why)) => {
                eprintln!("skipped: {name}: {why}");
                failed.extend(install.then_some(name));
            }
            Err(error) => {
                eprintln!("failed: {name}: {error}");
                failed.push(name);
            }
        }
    }
    eprintln!("tested in {:.0} s", all.elapsed().as_secs_f64());
    if failed.is_empty() { Ok(()) } else { Err(format!("failed or skipped: {}", failed.join(", "))) }
}

/// A photograph and a data set: those of the test data, or else generated ones.
fn inputs(tools: &Tools) -> Result<(PathBuf, PathBuf), String> {
    let data = env::var_os("GS_DATA").map_or_else(|| workspace().join("../shared/data"), PathBuf::from);
    if let Ok(data) = data.canonicalize() {
        let inputs = (data.join("kodak/kodim07.png"), data.join("banana"));
        if inputs.0.is_file() && inputs.1.is_dir() {
            return Ok(inputs);
        }
    }
    let folder = target().join("dist-test/inputs");
    empty(&folder)?;
    tools.script("test/scene.py", [&folder])?;
    Ok((folder.join("photo.png"), folder.join("dataset")))
}

impl Bench<'_> {
    /// An empty folder for a part.
    fn folder(&self, name: &str) -> Result<PathBuf, String> {
        let folder = target().join("dist-test").join(name);
        empty(&folder)?;
        Ok(folder)
    }

    /// Unpacks the archive for a system, and returns the folder in it.
    fn unpack(&self, system: &str, into: &Path) -> Result<PathBuf, String> {
        let name = format!("gs-{VERSION}-{system}");
        let ending = if system.contains("windows") { "zip" } else { "tar.gz" };
        let archive = self.release.join(format!("{name}.{ending}"));
        let module = if ending == "zip" { "zipfile" } else { "tarfile" };
        output(self.tools.command("python").args(["-m", module, "-e"]).args([&archive, into]))?;
        Ok(into.join(name))
    }

    /// Whether a program is there, after its packages of Debian were installed if that was asked for.
    fn has(&self, program: &str, packages: &[&str]) -> Result<bool, String> {
        if !has_program(program) && self.install {
            install_packages(packages)?;
        }
        Ok(has_program(program))
    }
}

/// An error if something that was expected does not hold.
fn expect(holds: bool, what: impl FnOnce() -> String) -> Result<(), String> {
    if holds { Ok(()) } else { Err(what()) }
}
