//! The program `gs`, on this system or on one that is emulated.

use std::{
    fs,
    io::{BufRead, BufReader, Read},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
};

use super::bench::{Bench, expect};
use xtask::system::{at, line, output, target};

/// A program for some system.
#[derive(Debug, Clone)]
pub(super) struct Program {
    path: PathBuf,
    /// What runs it, with its arguments.
    runner: Vec<&'static str>,
}

/// Wine, as Debian's package wine64 has it. The program `wine` is a script that asks for 32 bits, too.
const WINE: &str = "/usr/lib/wine/wine64";

/// The packages with QEMU, and with the libraries of Arm.
pub(super) const QEMU: [&str; 3] = ["qemu-user-static", "libc6-arm64-cross", "libgcc-s1-arm64-cross"];

/// How QEMU runs a program.
pub(super) const ON_ARM: [&str; 3] = ["qemu-aarch64-static", "-L", "/usr/aarch64-linux-gnu"];

impl Program {
    /// The program for this machine, x86-64 Linux.
    pub(super) fn linux(bench: &Bench<'_>, folder: &Path) -> Result<Option<Self>, String> {
        if cfg!(not(all(target_arch = "x86_64", target_os = "linux"))) {
            return Ok(None);
        }
        Ok(Some(Self { path: bench.unpack("x86_64-linux", folder)?.join("bin/gs"), runner: Vec::new() }))
    }

    /// The program for Windows, under Wine.
    pub(super) fn windows(bench: &Bench<'_>, folder: &Path) -> Result<Option<Self>, String> {
        if cfg!(not(target_os = "linux")) || !bench.has(WINE, &["wine64"])? {
            return Ok(None);
        }
        let program = bench.unpack("x86_64-windows", folder)?;
        let mut library = bench.tools.command("python");
        library.args(["-m", "ziglang", "cc", "-target", "x86_64-windows-gnu", "-shared", "-O1", "-s"]);
        library.args(["xtask/tests/dist/bcryptprimitives.c", "-ladvapi32", "-o"]);
        output(library.arg(program.join("bcryptprimitives.dll")))?;
        Ok(Some(Self { path: program.join("gs.exe"), runner: vec![WINE] }))
    }

    /// The program for Arm, under QEMU.
    pub(super) fn arm(bench: &Bench<'_>, folder: &Path) -> Result<Option<Self>, String> {
        if cfg!(not(target_os = "linux")) || !bench.has(ON_ARM[0], &QEMU)? {
            return Ok(None);
        }
        Ok(Some(Self { path: bench.unpack("aarch64-linux", folder)?.join("bin/gs"), runner: ON_ARM.to_vec() }))
    }

    /// Its file.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// The command with these arguments, to be run in a folder. Wine's messages of its own are off.
    fn command(&self, folder: &Path, arguments: &[&str]) -> Command {
        let words = self.runner.iter().map(AsRef::as_ref).chain([self.path.as_os_str()]);
        let words: Vec<_> = words.collect();
        let mut command = Command::new(words[0]);
        command.args(&words[1..]).args(arguments).current_dir(folder).stdin(Stdio::null());
        command.env("WINEPREFIX", target().join("dist-tools/wine")).env("WINEDEBUG", "-all").env("LC_ALL", "C.UTF-8");
        command
    }

    /// Runs the program to its end, and returns what it prints.
    pub(super) fn run(&self, folder: &Path, arguments: &[&str]) -> Result<String, String> {
        output(&mut self.command(folder, arguments))
    }

    /// Runs the program, which must refuse with this exit status and one line that contains this text.
    pub(super) fn refuses(&self, folder: &Path, arguments: &[&str], status: i32, text: &str) -> Result<(), String> {
        let mut command = self.command(folder, arguments);
        let ended = command.output().map_err(|error| format!("{}: {error}", line(&command)))?;
        let message = String::from_utf8_lossy(&ended.stderr).into_owned();
        let is_so = ended.status.code() == Some(status) && message.contains(text);
        expect(is_so, || format!("{}: {}, and not {status} with {text:?}: {message}", line(&command), ended.status))
    }

    /// Starts the program, and returns as soon as it has printed the progress of a step.
    pub(super) fn start(&self, folder: &Path, arguments: &[&str]) -> Result<Running, String> {
        let mut command = self.command(folder, arguments);
        let line = line(&command);
        eprintln!("== {line} &");
        let mut child =
            command.stderr(Stdio::piped()).stdout(Stdio::null()).spawn().map_err(|e| format!("{line}: {e}"))?;
        let mut errors = BufReader::new(child.stderr.take().ok_or("no standard error")?);
        let mut text = String::new();
        while !text.lines().any(|line| line.starts_with("step ")) {
            let read = errors.read_line(&mut text).map_err(|error| format!("{line}: {error}"))?;
            expect(read > 0, || format!("{line} ended before the first step: {text}"))?;
        }
        Ok(Running { child, errors: Box::new(errors), text, line })
    }
}

/// A program at work.
pub(super) struct Running {
    child: Child,
    errors: Box<dyn Read>,
    text: String,
    line: String,
}

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended.
        let _ended = self.child.kill().and_then(|()| self.child.wait());
    }
}

impl Running {
    /// Sends Ctrl-C, upon which the program must keep what it has and end with the status of that.
    pub(super) fn interrupt(mut self) -> Result<(), String> {
        output(Command::new("kill").args(["-INT", &self.child.id().to_string()]))?;
        self.errors.read_to_string(&mut self.text).map_err(|error| format!("{}: {error}", self.line))?;
        let ended = self.child.wait().map_err(|error| format!("{}: {error}", self.line))?;
        let is_so = ended.code() == Some(130) && self.text.contains("stopped after step");
        expect(is_so, || format!("{} after Ctrl-C: {ended}: {}", self.line, self.text))
    }
}

/// Whether files have the same bytes, and how many.
pub(super) fn equal(one: &Path, other: &Path) -> Result<bool, String> {
    let read = |path: &Path| fs::read(path).map_err(at(path));
    let (one, other) = (read(one)?, read(other)?);
    Ok(!one.is_empty() && one == other)
}
