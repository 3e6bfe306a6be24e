//! The test of `cargo xtask dist --test`: the release where it will run.

mod arm;
mod bare;
mod bench;
mod bits;
mod mac;
mod npm;
mod program;
mod sizes;
mod wheel;
mod windows;

use std::{env, path::PathBuf, process::ExitCode, time::Instant};

use self::bench::{Bench, Outcome};
use xtask::{
    dist::tools::Tools,
    system::{Options, empty, started, step, target, workspace},
};

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

fn main() -> ExitCode {
    started(run)
}

/// Runs all parts, and fails after the last one if any has failed, or was skipped although everything that is
/// needed was to be installed.
fn run(Options { install, .. }: Options) -> Result<(), String> {
    let tools = &Tools::prepared()?;
    let (image, dataset) = inputs(tools)?;
    // Building belongs to the release, not to what its test takes.
    let conformance = arm::built(tools)?;
    let bench = Bench { tools, release: &target().join("dist"), image, dataset, conformance, install };
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
    step(tools.command("python").arg("xtask/tests/dist/scene.py").arg(&folder))?;
    Ok((folder.join("photo.png"), folder.join("dataset")))
}
