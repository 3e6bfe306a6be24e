//! What makes releases: an environment of Python with pinned tools, and what makes their results the same
//! each time.

use std::{
    env,
    ffi::OsStr,
    path::{Path, PathBuf},
    process::Command,
};

use super::systems::SYSTEMS;
use crate::{
    python,
    system::{self, cargo_program, output, step, target, workspace},
    web,
};

/// The tools, from PyPI, with the checksums of their files. Zig is the linker and the C compiler for each system.
const PACKAGES: &str = "xtask/src/dist/tools.txt";

/// The tools.
#[derive(Debug)]
pub struct Tools {
    folder: PathBuf,
    /// Seconds since 1970 of the commit, which stand for all times in files.
    pub epoch: String,
}

impl Tools {
    /// Makes the environment, and checks that the compiler has the targets.
    pub fn prepare(install: bool) -> Result<Self, String> {
        for system in SYSTEMS {
            system::need_target(system.triple, install)?;
        }
        system::need_target(web::TARGET, install)?;
        web::need_std_sources(install)?;
        web::need_npm()?;
        let python = python::with_environments(11, install)?
            .ok_or("there is no Python 3.11 or later with the module venv: Debian 12 and Ubuntu 24.04 have one")?;
        let tools = Self::prepared()?;
        let mut pip = python::environment(python, &tools.folder.join("python"))?;
        step(pip.args(["--require-hashes", "--requirement"]).arg(workspace().join(PACKAGES)))?;
        Ok(tools)
    }

    /// The tools that were prepared in this workspace.
    pub fn prepared() -> Result<Self, String> {
        Ok(Self { folder: target().join("dist-tools"), epoch: epoch()? })
    }

    /// The folder of the environment's programs.
    pub fn programs(&self) -> PathBuf {
        python::programs(&self.folder.join("python"))
    }

    /// A program of the environment, to be run in the workspace, whose results do not depend on the time or on
    /// where the workspace is.
    pub fn command(&self, program: &str) -> Command {
        let mut command = Command::new(self.programs().join(program));
        let path = env::var_os("PATH").unwrap_or_default();
        let folders = [self.programs()].into_iter().chain(env::split_paths(&path));
        if let Ok(path) = env::join_paths(folders) {
            command.env("PATH", path);
        }
        command.env("CARGO", cargo_program()).env("SOURCE_DATE_EPOCH", &self.epoch).env("CARGO_INCREMENTAL", "0");
        command.env("CARGO_ENCODED_RUSTFLAGS", system::remapped_paths().join("\x1f")).env_remove("RUSTFLAGS");
        command.env("CARGO_ZIGBUILD_CACHE_DIR", self.folder.join("zig-linkers"));
        for cache in ["ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR"] {
            command.env(cache, self.folder.join("zig-cache"));
        }
        command.current_dir(workspace());
        command
    }

    /// Runs a script of this folder.
    pub fn script<A: AsRef<OsStr>>(&self, name: &str, arguments: impl IntoIterator<Item = A>) -> Result<(), String> {
        let mut python = self.command("python");
        step(python.arg(Path::new("xtask/src/dist").join(name)).args(arguments))
    }
}

/// The time of the commit, or what the environment says.
fn epoch() -> Result<String, String> {
    if let Ok(epoch) = env::var("SOURCE_DATE_EPOCH") {
        return Ok(epoch);
    }
    let time = output(Command::new("git").args(["log", "-1", "--format=%ct"]).current_dir(workspace()));
    let time = time.map_err(|error| format!("no commit's time can be taken, so set SOURCE_DATE_EPOCH: {error}"))?;
    Ok(time.trim().to_owned())
}
