//! The programs and the wheels of all systems.

use std::{
    env,
    path::{Path, PathBuf},
};

use super::{
    papers::{NOTICES, Papers},
    systems::{SYSTEMS, System},
    tools::Tools,
};
use crate::{
    python,
    system::{VERSION, copy, empty, step, target},
};

/// The profile of Cargo.toml.
pub const PROFILE: &str = "shipped";

/// What was built for a system.
#[derive(Debug, Clone)]
pub struct Built {
    /// The program `gs`.
    pub program: PathBuf,
    /// The library that Python loads.
    pub module: PathBuf,
}

/// Builds the program and the Python module for each system, together, since they share their crates.
pub fn all(tools: &Tools) -> Result<Vec<Built>, String> {
    SYSTEMS.iter().map(|system| built(tools, system)).collect()
}

fn built(tools: &Tools, system: &System) -> Result<Built, String> {
    let mut build = tools.command("cargo-zigbuild");
    build.args(["zigbuild", "--locked", "--profile", PROFILE, "-p", "gs-cli", "-p", "gs-python"]);
    build.args(["--features", "gs-cli/manual", "--target", &format!("{}{}", system.triple, system.glibc)]);
    // The module is for each Python with the stable ABI, and uses the symbols of the process that loads it.
    build.env("PYO3_NO_PYTHON", "1");
    step(build.arg("--target-dir").arg(target()))?;
    let [program, module] = if system.is_windows() { ["gs.exe", "_native.dll"] } else { ["gs", "lib_native.so"] };
    let folder = target().join(system.triple).join(PROFILE);
    Ok(Built { program: folder.join(program), module: folder.join(module) })
}

/// Writes man pages and completions for a name of the command, by the program for this machine.
pub(super) fn manual(tools: &Tools, built: &[Built], name: &str) -> Result<PathBuf, String> {
    let here = |system: &System| {
        let mut parts = system.name.split('-');
        parts.next() == Some(env::consts::ARCH) && parts.next() == Some(env::consts::OS)
    };
    let program = SYSTEMS.iter().position(here).map(|index| &built[index].program);
    let program = program.ok_or("releases are built on x86-64 Linux or Windows, or on 64-bit Arm Linux")?;
    let folder = target().join("dist-tools/manual").join(name);
    empty(&folder)?;
    let mut write = std::process::Command::new(program);
    step(write.arg("manual").arg(&folder).arg(name).env("SOURCE_DATE_EPOCH", &tools.epoch))?;
    Ok(folder)
}

/// Packs the wheel for a system, with what it is made of, into a folder.
pub(super) fn wheel(tools: &Tools, system: &System, built: &Built, papers: &Papers, out: &Path) -> Result<(), String> {
    let tree = target().join("dist-tools/wheels").join(system.name).join(format!("gaussian_splats-{VERSION}"));
    python::wheel_tree(&tree, &built.module)?;
    let info = python::wheel_information(&tree);
    copy(&papers.notices, &info.join("licenses").join(NOTICES))?;
    // The place that PEP 770 gives it.
    copy(&papers.module, &info.join("sboms/gaussian_splats.cdx.json"))?;
    python::pack_wheel(|program| tools.command(program), &tree, Some(system.wheel), out)
}
