//! What the parts of the test share.

use std::path::{Path, PathBuf};

use xtask::{
    dist::tools::Tools,
    system::{VERSION, empty, has_program, install_packages, output, target},
};

/// The release, and what it is tested with.
#[derive(Debug)]
pub(super) struct Bench<'a> {
    pub(super) tools: &'a Tools,
    /// The folder of the release.
    pub(super) release: &'a Path,
    /// A photograph.
    pub(super) image: PathBuf,
    /// A data set of views with their poses.
    pub(super) dataset: PathBuf,
    /// The test program of gs-conformance for Arm.
    pub(super) conformance: PathBuf,
    /// Install what is needed.
    pub(super) install: bool,
}

/// How a part ended: what was seen, or why it did not run.
pub(super) enum Outcome {
    Passed(String),
    Skipped(String),
}

impl Bench<'_> {
    /// An empty folder for a part.
    pub(super) fn folder(&self, name: &str) -> Result<PathBuf, String> {
        let folder = target().join("dist-test").join(name);
        empty(&folder)?;
        Ok(folder)
    }

    /// Unpacks the archive for a system, and returns the folder in it.
    pub(super) fn unpack(&self, system: &str, into: &Path) -> Result<PathBuf, String> {
        let name = format!("gs-{VERSION}-{system}");
        let ending = if system.contains("windows") { "zip" } else { "tar.gz" };
        let archive = self.release.join(format!("{name}.{ending}"));
        let module = if ending == "zip" { "zipfile" } else { "tarfile" };
        output(self.tools.command("python").args(["-m", module, "-e"]).args([&archive, into]))?;
        Ok(into.join(name))
    }

    /// Whether a program is there, after its packages of Debian were installed if that was asked for.
    pub(super) fn has(&self, program: &str, packages: &[&str]) -> Result<bool, String> {
        if !has_program(program) && self.install {
            install_packages(packages)?;
        }
        Ok(has_program(program))
    }
}

/// An error if something that was expected does not hold.
pub(super) fn expect(holds: bool, what: impl FnOnce() -> String) -> Result<(), String> {
    if holds { Ok(()) } else { Err(what()) }
}
