//! Runs of the program, and their outcomes.

use std::{
    ffi::OsStr,
    fs,
    path::{Path, PathBuf},
    process::{Command, Output, Stdio},
};

use gs_core::Image;

/// The outcome of a run of the program.
#[derive(Debug)]
pub(crate) struct Run {
    pub(crate) status: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

/// Runs `gs` with these arguments.
pub(crate) fn gs<A: AsRef<OsStr>>(arguments: impl IntoIterator<Item = A>) -> Run {
    Run::of(command().args(arguments))
}

/// The program, to be run in other ways.
pub(crate) fn command() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_gs"));
    command.stdin(Stdio::null());
    // As in a container, where Linux' graphics drivers would write a line of their own to standard
    // error if the program let them.
    command.env_remove("XDG_RUNTIME_DIR").env_remove("RAYON_NUM_THREADS").env_remove("GS_DATA");
    command
}

impl Run {
    /// Runs the program as it stands.
    pub(crate) fn of(command: &mut Command) -> Self {
        Self::ended(command.output().expect("the program starts"))
    }

    /// Runs `gs` with these arguments and this on standard input, which `/dev/stdin` names.
    #[cfg(unix)]
    pub(crate) fn fed(arguments: &[&str], input: &str) -> Self {
        let mut command = command();
        command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().expect("the program starts");
        // The results show whether the program reads all of it.
        let _ = std::io::Write::write_all(&mut child.stdin.take().expect("it is piped"), input.as_bytes());
        Self::ended(child.wait_with_output().expect("the program ends"))
    }

    pub(crate) fn ended(output: Output) -> Self {
        Self {
            status: output.status.code(),
            stdout: String::from_utf8(output.stdout).expect("standard output is UTF-8"),
            stderr: String::from_utf8(output.stderr).expect("standard error is UTF-8"),
        }
    }

    /// The run, which must have succeeded.
    #[track_caller]
    pub(crate) fn done(self) -> Self {
        assert_eq!(self.status, Some(0), "{self:?}");
        self
    }

    /// The JSON object on standard output of a run that must have succeeded.
    #[track_caller]
    pub(crate) fn json(self) -> serde_json::Value {
        let run = self.done();
        serde_json::from_str(&run.stdout).unwrap_or_else(|error| panic!("{error}: {run:?}"))
    }

    /// The one line of a run that must have been refused: nothing on standard output, status 1 or
    /// 2.
    #[track_caller]
    pub(crate) fn refusal(&self) -> &str {
        assert!(matches!(self.status, Some(1 | 2)), "{self:?}");
        assert_eq!(self.stdout, "", "{self:?}");
        let lines: Vec<&str> = self.stderr.lines().collect();
        assert_eq!(lines.len(), 1, "{self:?}");
        assert!(lines[0].starts_with("error: ") && lines[0].len() > 20, "{self:?}");
        lines[0]
    }
}

/// A folder for one test, gone with it.
pub(crate) fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

/// The names in a folder, sorted, but for the two of the program's own files.
pub(crate) fn names_in(folder: &Path) -> Vec<String> {
    let names = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> =
        names.filter(|name| ![".gs-files.json", ".gs-lock"].contains(&name.as_str())).collect();
    names.sort();
    names
}

/// Sends a signal to a process so often, at once.
#[cfg(unix)]
pub(crate) fn signal(process: &std::process::Child, signal: &str, times: usize) {
    let process = process.id().to_string();
    (0..times).for_each(|_| assert!(Command::new("kill").args([signal, &process]).status().unwrap().success()));
}

/// Writes a picture with an edge, a slope and a spot, and returns its path.
pub(crate) fn picture(folder: &Path, width: u32, height: u32) -> PathBuf {
    let color = |x: u32, y: u32| {
        let (u, v) = ((x as f32 + 0.5) / width as f32, (y as f32 + 0.5) / height as f32);
        let spot = (-40.0 * ((u - 0.3).powi(2) + (v - 0.6).powi(2))).exp();
        [if u > 0.5 { 0.9 } else { 0.2 }, v, spot]
    };
    let path = folder.join(format!("picture-{width}x{height}.png"));
    gs_io::write_png(&path, &Image::from_fn(width, height, color).unwrap()).unwrap();
    path
}
