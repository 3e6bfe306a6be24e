//! What makes releases: an environment of Python with pinned tools, and what makes their results the same
//! each time.

use std::{
    env,
    ffi::OsStr,
    path::{Path, PathBuf},
    process::Command,
};

use crate::{
    python,
    system::{self, cargo_program, step, target, workspace},
    web,
};

/// The tools, from PyPI, with the checksums of their files. Zig is the linker and the C compiler for each system.
const PACKAGES: &str = "xtask/src/dist/tools.txt";

/// The tools.
#[derive(Debug)]
pub(crate) struct Tools {
    folder: PathBuf,
    /// Seconds since 1970 of the commit, which stand for all times in files.
    pub(crate) epoch: String,
}

impl Tools {
    /// Makes the environment, and checks that the compiler has the targets.
    pub(crate) fn prepare(install: bool) -> Result<Self, String> {
        for system in super::SYSTEMS {
            system::need_target(system.triple, install)?;
        }
        system::need_target(web::TARGET, install)?;
        web::need_std_sources(install)?;
        web::need_npm()?;
        let python = python::with_environments(11, install)?
            .ok_or("there is no Python 3.11 or later with the module venv: Debian 12 and Ubuntu 24.04 have one")?;
        let tools = Self { folder: target().join("dist-tools"), epoch: epoch()? };
        step(Command::new(python).args(["-m", "venv"]).arg(tools.folder.join("python")))?;
        let mut pip = tools.command("python");
        pip.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--retries", "2"]);
        step(pip.args(["--require-hashes", "--requirement", PACKAGES]))?;
        Ok(tools)
    }

    /// The folder of the environment's programs.
    fn programs(&self) -> PathBuf {
        self.folder.join("python").join(if cfg!(windows) { "Scripts" } else { "bin" })
    }

    /// A program of the environment, to be run in the workspace, whose results do not depend on the time or on
    /// where the workspace is.
    pub(crate) fn command(&self, program: &str) -> Command {
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
    pub(crate) fn script<A: AsRef<OsStr>>(
        &self,
        name: &str,
        arguments: impl IntoIterator<Item = A>,
    ) -> Result<(), String> {
        let mut python = self.command("python");
        step(python.arg(Path::new("xtask/src/dist").join(name)).args(arguments))
    }
}

/// The time of the commit, or what the environment says.
fn epoch() -> Result<String, String> {
    if let Ok(epoch) = env::var("SOURCE_DATE_EPOCH") {
        return Ok(epoch);
    }
    let git = Command::new("git").args(["log", "-1", "--format=%ct"]).current_dir(workspace()).output();
    let output = git.ok().filter(|output| output.status.success());
    let output = output.ok_or("there is no commit here whose time could be taken: set SOURCE_DATE_EPOCH")?;
    Ok(String::from_utf8_lossy(&output.stdout).trim().to_owned())
}
