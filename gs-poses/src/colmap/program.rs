//! The program that finds poses: COLMAP, or PyCOLMAP of a Python.

use std::{
    env,
    ffi::OsString,
    fmt, io,
    process::{Command, Stdio},
};

/// Runs the same commands by PyCOLMAP.
const SCRIPT: &str = include_str!("pycolmap.py");

/// The variable of the environment that names a Python that has PyCOLMAP.
const PYTHON: &str = "GS_PYTHON";

/// A program that takes COLMAP's commands.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Program {
    /// COLMAP, by its name.
    Colmap(&'static str),
    /// This Python, which has PyCOLMAP.
    Python(OsString),
}

impl Program {
    /// The programs that are looked for, the preferred one first; `python` is used if the environment names no other.
    pub(crate) fn candidates(python: Option<OsString>) -> impl Iterator<Item = Self> {
        // On Windows, COLMAP is started by a batch file.
        let (colmap, usual): (&[_], _) =
            if cfg!(windows) { (&["colmap", "COLMAP.bat"], "python") } else { (&["colmap"], "python3") };
        let named = env::var_os(PYTHON).filter(|python| !python.is_empty());
        let python = named.or(python).unwrap_or_else(|| usual.into());
        colmap.iter().map(|name| Self::Colmap(name)).chain([Self::Python(python)])
    }

    /// The program, before a command and its options.
    pub(crate) fn command(&self) -> Command {
        let mut command = match self {
            Self::Colmap(name) => Command::new(name),
            Self::Python(python) => {
                let mut command = Command::new(python);
                command.args(["-c", SCRIPT]).env("PYTHONUNBUFFERED", "1");
                command
            }
        };
        command.env("QT_QPA_PLATFORM", "offscreen").stdin(Stdio::null());
        command
    }

    /// What it prints, and whether it succeeds.
    pub(crate) fn said(&self, arguments: &[&str]) -> io::Result<(bool, String)> {
        said(self.command().args(arguments))
    }
}

/// What a command prints, and whether it succeeds.
pub(crate) fn said(command: &mut Command) -> io::Result<(bool, String)> {
    let output = command.output()?;
    let text = [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes));
    Ok((output.status.success(), text.concat()))
}

impl fmt::Display for Program {
    /// Its name, with that of the Python.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Colmap(name) => f.write_str(name),
            Self::Python(python) => write!(f, "PyCOLMAP of {}", python.to_string_lossy()),
        }
    }
}

/// A version in words, without a patch of 0.
pub(crate) fn dotted([major, minor, patch]: [u32; 3]) -> String {
    if patch == 0 { format!("{major}.{minor}") } else { format!("{major}.{minor}.{patch}") }
}
