//! Runs COLMAP as a process: its output goes to a log, and line by line to a function.

use std::{
    fs::{File, OpenOptions},
    io::{BufRead, BufReader, Read, Write},
    path::{Path, PathBuf},
    process::{ExitStatus, Stdio},
    sync::mpsc::{RecvTimeoutError, Sender, channel},
    thread,
    time::Duration,
};

use super::{Arguments, program::Program};
use crate::error::Error;

/// How often the caller is asked whether to go on.
pub(crate) const PAUSE: Duration = Duration::from_millis(100);

/// COLMAP's log.
#[derive(Debug)]
pub(crate) struct Log {
    file: File,
    pub(crate) path: PathBuf,
}

impl Log {
    /// Opens the log; `resume` adds to it.
    pub(crate) fn open(path: PathBuf, resume: bool) -> Result<Self, Error> {
        let file = OpenOptions::new().create(true).write(true).append(resume).truncate(!resume).open(&path);
        Ok(Self { file: file.map_err(Error::at(&path))?, path })
    }

    fn line(&mut self, line: &str) {
        // Without space for its log, the work goes on.
        let _ = writeln!(self.file, "{line}");
    }

    /// Runs a command of COLMAP; `each` is told its lines, and `cancelled` ends it.
    pub(crate) fn run(
        &mut self,
        program: &Program,
        arguments: &Arguments,
        stage: &'static str,
        each: &mut dyn FnMut(&str),
        cancelled: &dyn Fn() -> bool,
    ) -> Result<(), Error> {
        let shown: Vec<_> = arguments.0.iter().map(|argument| argument.to_string_lossy()).collect();
        self.line(&format!("$ {program} {}", shown.join(" ")));
        let mut command = program.command();
        command.args(&arguments.0).stdout(Stdio::piped()).stderr(Stdio::piped());
        let failed = |error| Error::at(program.to_string())(error);
        let mut child = command.spawn().map_err(failed)?;
        let (sender, lines) = channel();
        child.stdout.take().into_iter().for_each(|pipe| forward(pipe, sender.clone()));
        child.stderr.take().into_iter().for_each(|pipe| forward(pipe, sender.clone()));
        drop(sender);
        let mut said = None;
        let status = loop {
            match lines.recv_timeout(PAUSE) {
                Ok(line) => {
                    self.line(&line);
                    said = error_in(&line).or(said);
                    each(without_prefix(&line));
                }
                Err(RecvTimeoutError::Disconnected) => break child.wait().map_err(failed)?,
                // Another process may still hold the pipes.
                Err(RecvTimeoutError::Timeout) => {
                    if let Some(status) = child.try_wait().map_err(failed)? {
                        break status;
                    }
                }
            }
            if cancelled() {
                let _ = child.kill();
                let _ = child.wait();
                return Err(Error::Cancelled { stage });
            }
        };
        // Ctrl-C in a terminal also reaches COLMAP.
        if cancelled() && !status.success() {
            return Err(Error::Cancelled { stage });
        }
        if status.success() {
            return Ok(());
        }
        Err(Error::Failed { stage, how: ending(status), said, log: self.path.clone() })
    }
}

/// Sends the lines of a pipe.
fn forward(pipe: impl Read + Send + 'static, to: Sender<String>) {
    thread::spawn(move || {
        let mut pipe = BufReader::new(pipe);
        let mut bytes = Vec::new();
        while pipe.read_until(b'\n', &mut bytes).is_ok_and(|read| read > 0) {
            let line = String::from_utf8_lossy(&bytes).trim_end().to_owned();
            bytes.clear();
            if to.send(line).is_err() {
                return;
            }
        }
    });
}

/// A line without what newer versions put in front: "I20260101 12:00:00.000000 123 mapper.cc:12] ".
pub(crate) fn without_prefix(line: &str) -> &str {
    let is_logged = line.starts_with(['I', 'W', 'E', 'F']) && line.as_bytes().get(1).is_some_and(u8::is_ascii_digit);
    line.split_once("] ").filter(|_| is_logged).map_or(line, |(_, text)| text)
}

/// What went wrong, if a line says it.
fn error_in(line: &str) -> Option<String> {
    let is_logged = line.starts_with(['E', 'F']) && line.as_bytes().get(1).is_some_and(u8::is_ascii_digit);
    let is_error = |word: &&str| line.contains(*word);
    if line.contains("bad_alloc") {
        return Some("std::bad_alloc: out of memory".to_owned());
    }
    let words = ["ERROR", "Check failed", "terminate called", "what():", "SQLite error"];
    (is_logged || words.iter().any(is_error)).then(|| without_prefix(line).trim().to_owned())
}

/// Whether an error is that with which COLMAP ends where the photographs cannot be reconstructed.
pub(crate) fn finds_nothing(error: &str) -> bool {
    // "any" stands in between since version 4.
    let error = error.to_lowercase();
    error.contains("failed to create") && error.contains("sparse model")
}

/// Whether an error says that a vocabulary tree cannot be fetched or read.
pub(crate) fn lacks_tree(error: &str) -> bool {
    let error = error.to_lowercase();
    ["download", "vocab", "http", "index"].iter().any(|word| error.contains(word))
}

/// How a process ended.
fn ending(status: ExitStatus) -> String {
    #[cfg(unix)]
    if let Some(signal) = std::os::unix::process::ExitStatusExt::signal(&status) {
        let why = if signal == 9 { " (out of memory?)" } else { "" };
        return format!("was killed by signal {signal}{why}");
    }
    match status.code() {
        Some(code) => format!("ended with status {code}"),
        None => "was killed".to_owned(),
    }
}

/// Adds up the features of each photograph that COLMAP's log names.
pub(crate) fn features_in(log: &Path) -> std::collections::BTreeMap<String, u32> {
    let mut found = std::collections::BTreeMap::new();
    let mut name = None;
    let text = std::fs::read(log).unwrap_or_default();
    for line in String::from_utf8_lossy(&text).lines().map(|line| without_prefix(line).trim()) {
        if let Some(rest) = line.strip_prefix("Name:") {
            name = Some(rest.trim().to_owned());
        } else if let Some(count) = line.strip_prefix("Features:").and_then(|count| count.split_whitespace().next())
            && let (Some(name), Ok(count)) = (name.take(), count.parse())
        {
            found.insert(name, count);
        }
    }
    found
}

/// Done and total of a line such as "Processed file [3/14]", "Matching block [2/5, 4/5] in 3 s".
pub(crate) fn fraction(line: &str) -> Option<(usize, usize)> {
    let inside = line.split_once('[')?.1.split_once(']')?.0;
    let part = |text: &str| -> Option<(usize, usize)> {
        let (done, of) = text.trim().split_once('/')?;
        Some((done.parse().ok()?, of.parse().ok()?))
    };
    match inside.split_once(',') {
        None => part(inside),
        Some((outer, inner)) => {
            let ((row, rows), (column, columns)) = (part(outer)?, part(inner)?);
            Some((row.saturating_sub(1) * columns + column, rows * columns))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_both_kinds_of_versions_are_understood() {
        let newer = "I20260101 12:00:00.000000 123 feature_extraction.cc:257] Processed file [3/14]";
        for line in ["Processed file [3/14]", newer] {
            assert_eq!(fraction(without_prefix(line)), Some((3, 14)), "{line}");
        }
        assert_eq!(fraction("Matching block [2/5, 4/5] in 3.1s"), Some((9, 25)));
        assert_eq!((fraction("Registering image #5 (4)"), fraction("[1/x]"), fraction("[]")), (None, None, None));
    }

    #[test]
    fn errors_of_both_kinds_of_versions_are_understood() {
        assert_eq!(error_in("F2026 x.cc:1] Check failed: a > 0").as_deref(), Some("Check failed: a > 0"));
        assert_eq!(error_in("  what():  std::bad_alloc").as_deref(), Some("std::bad_alloc: out of memory"));
        let refused = "ERROR: Failed to parse options - unrecognised option '--x'.";
        let unreadable = "SQLite error [./src/base/database.cc, line 267]: file is not a database";
        for line in [refused, unreadable] {
            assert_eq!(error_in(line).as_deref(), Some(line));
            assert!(!finds_nothing(line));
        }
        assert_eq!((error_in("Elapsed time"), error_in("I2026 x.cc:1] Failed")), (None, None));
        let of_4 = "E2026 sfm.cc:279] Failed to create any sparse model";
        for line in ["ERROR: failed to create sparse model", "E2026 sfm.cc:2] Failed to create sparse model", of_4] {
            assert!(finds_nothing(&error_in(line).unwrap()), "{line}");
        }
    }

    #[test]
    fn the_log_says_how_many_features_were_found() {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("a.log");
        let newer = "I2026 1 f.cc:1]   Name:            b é.jpg\nI2026 1 f.cc:1]   Features:        812 (SIFT)\n";
        std::fs::write(&log, format!("  Name:            a.jpg\n  Features:        7\n{newer}  Name: c.jpg\nERROR\n"))
            .unwrap();
        let expected = [("a.jpg".to_owned(), 7), ("b é.jpg".to_owned(), 812)];
        assert_eq!(features_in(&log), expected.into_iter().collect());
    }
}
