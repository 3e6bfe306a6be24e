//! How a command fails: one line that says where, what and what to do, and an exit status.

use std::{fmt::Display, io, process::ExitCode};

/// Exit status of a command that was stopped by Ctrl-C: 128 + SIGINT, as shells have it.
const INTERRUPTED: u8 = 130;

/// The kind of a failure decides the exit status.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Cause {
    /// The command line asks for something impossible: status 2.
    Usage,
    /// The command could not do its work: status 1.
    Failed,
    /// The backend failed, such as a GPU that was lost: status 1. Checkpoints stored before are
    /// usable.
    Backend,
    /// The training diverged: status 1. Checkpoints stored before are usable.
    Diverged,
    /// Ctrl-C: status 130.
    Interrupted,
    /// The reader of our output has closed it: status 0, and no message.
    BrokenPipe,
}

/// Why a command failed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Failure {
    kind: Cause,
    message: String,
}

impl Failure {
    /// The command could not do its work.
    pub(crate) fn failed(message: impl Display) -> Self {
        Self { kind: Cause::Failed, message: one_line(message) }
    }

    /// The command line asks for something impossible.
    pub(crate) fn usage(message: impl Display) -> Self {
        Self { kind: Cause::Usage, message: one_line(message) }
    }

    /// The command was stopped by Ctrl-C, and what it had was saved.
    pub(crate) fn interrupted(message: impl Display) -> Self {
        Self { kind: Cause::Interrupted, message: one_line(message) }
    }

    /// A scene could not be read or written. If its content is broken, `gs doctor` can repair it.
    pub(crate) fn of_scene(error: gs_io::Error) -> Self {
        match error {
            gs_io::Error::Content { .. } => Self::from(error)
                .hint("gs doctor SCENE shows what is broken, and gs convert SCENE OUT --drop-broken repairs it"),
            _ => error.into(),
        }
    }

    /// Standard output could not be written.
    pub(crate) fn output(source: io::Error) -> Self {
        match source.kind() {
            io::ErrorKind::BrokenPipe => Self { kind: Cause::BrokenPipe, message: String::new() },
            _ => Self::failed(format!("standard output: {source}")),
        }
    }

    /// Adds what to do about it, in parentheses where the message already asks "did you mean ...?".
    pub(crate) fn hint(mut self, how: impl Display) -> Self {
        let how = one_line(how);
        self.message = match self.message.ends_with('?') {
            true => format!("{} ({how})", self.message),
            false => format!("{}: {how}", self.message),
        };
        self
    }

    /// Puts the place in front: a file, a flag.
    pub(crate) fn at(mut self, place: impl Display) -> Self {
        self.message = format!("{}: {}", one_line(place), self.message);
        self
    }

    /// Whether the backend failed, rather than its input.
    pub(crate) fn is_of_backend(&self) -> bool {
        self.kind == Cause::Backend
    }

    /// Whether the training diverged. Continuing with the same settings would diverge again.
    pub(crate) fn is_divergence(&self) -> bool {
        self.kind == Cause::Diverged
    }

    /// The first of several failures, with the number of the others.
    pub(crate) fn first_of(tried: impl IntoIterator<Item = Result<(), Self>>) -> Result<(), Self> {
        let mut failures = tried.into_iter().filter_map(Result::err);
        let Some(first) = failures.next() else { return Ok(()) };
        match failures.count() {
            0 => Err(first),
            others => Err(first.hint(format_args!("{others} more of the results failed, too"))),
        }
    }

    /// The message alone, for a longer line.
    pub(crate) fn message(&self) -> &str {
        &self.message
    }

    /// The line for standard error, without its line break; `None` if there is nothing to say.
    pub(crate) fn line(&self) -> Option<String> {
        match self.kind {
            Cause::Usage | Cause::Failed | Cause::Backend | Cause::Diverged => Some(format!("error: {}", self.message)),
            Cause::Interrupted => Some(self.message.clone()),
            Cause::BrokenPipe => None,
        }
    }

    /// The program's exit status.
    pub(crate) fn status(&self) -> ExitCode {
        match self.kind {
            Cause::Usage => ExitCode::from(2),
            Cause::Failed | Cause::Backend | Cause::Diverged => ExitCode::FAILURE,
            Cause::Interrupted => ExitCode::from(INTERRUPTED),
            Cause::BrokenPipe => ExitCode::SUCCESS,
        }
    }
}

impl From<gs_core::Error> for Failure {
    fn from(error: gs_core::Error) -> Self {
        match error {
            gs_core::Error::Setting { .. } => Self::usage(error),
            gs_core::Error::Backend { .. } => Self { kind: Cause::Backend, message: one_line(error) },
            _ => Self::failed(error),
        }
    }
}

impl From<gs_io::Error> for Failure {
    fn from(error: gs_io::Error) -> Self {
        match error {
            gs_io::Error::UnknownEnding { .. } => Self::usage(error),
            gs_io::Error::NoViews { outside: true, .. } => {
                Self::failed(error).hint("read it with --allow-outside, if you trust the author of the data set")
            }
            gs_io::Error::LeavesDataset { .. } => Self::failed(format!("{error}, or pass --allow-outside")),
            gs_io::Error::IsInput { .. } => Self::usage(error).hint("write the results elsewhere"),
            gs_io::Error::InTheWay { .. } => {
                Self::failed(error).hint("choose another folder with --output, or replace such files with --overwrite")
            }
            gs_io::Error::Busy { .. } => {
                Self::failed(error).hint("wait for it, or choose another folder with --output")
            }
            gs_io::Error::Remove { .. } => Self::failed(error).hint("choose another folder with --output"),
            _ => Self::failed(error),
        }
    }
}

impl From<gs_train::Error> for Failure {
    fn from(error: gs_train::Error) -> Self {
        match error {
            gs_train::Error::Core(error) => error.into(),
            gs_train::Error::Io(error) => error.into(),
            gs_train::Error::Diverged { .. } => Self { kind: Cause::Diverged, message: one_line(error) },
            _ => Self::failed(error),
        }
    }
}

impl From<gs_poses::Error> for Failure {
    fn from(error: gs_poses::Error) -> Self {
        match error {
            gs_poses::Error::Io(error) => error.into(),
            gs_poses::Error::HasPoses { .. } => Self::failed(error).hint("choose another folder with --output"),
            _ => Self::failed(error),
        }
    }
}

impl From<gs_lab::Error> for Failure {
    fn from(error: gs_lab::Error) -> Self {
        use gs_lab::Error::{Arm, Backend, Fit, Form, Io, NoTarget, Study, Unknown};
        match error {
            Fit(error) => error.into(),
            Io(error) => error.into(),
            Backend { .. } => Self { kind: Cause::Backend, message: one_line(error) },
            Form { .. } | Study { .. } | Arm { .. } | Unknown { .. } | NoTarget { .. } => Self::usage(error),
            _ => Self::failed(error),
        }
    }
}

/// Quits at once, as a second Ctrl-C asks. Results are written under temporary names, which are
/// removed, so none is incomplete.
pub(crate) fn quit_now() -> ! {
    gs_io::abandon_writes();
    std::process::exit(i32::from(INTERRUPTED))
}

/// Joins the lines of a message: those of parsers have several.
fn one_line(message: impl Display) -> String {
    let text = message.to_string();
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failure_is_one_line_of_where_what_and_hint() {
        let failure = Failure::failed("is a\n folder").at("out/x").hint("name a file");
        assert_eq!(failure.line().as_deref(), Some("error: out/x: is a folder: name a file"));
    }

    #[test]
    fn a_hint_after_a_question_is_in_parentheses() {
        let failure = Failure::usage("unknown key `accurcy`: did you mean `accuracy`?").hint("compare it with a.toml");
        let line = "error: unknown key `accurcy`: did you mean `accuracy`? (compare it with a.toml)";
        assert_eq!(failure.line().as_deref(), Some(line));
    }

    #[test]
    fn the_first_of_several_failures_is_shown_and_the_others_counted() {
        assert_eq!(Failure::first_of([Ok(()), Ok(())]), Ok(()));
        let failed = |name| Err(Failure::failed(name));
        assert_eq!(Failure::first_of([Ok(()), failed("a")]), failed("a"));
        let line = Failure::first_of([failed("a"), Ok(()), failed("b"), failed("c")]).unwrap_err().line().unwrap();
        assert_eq!(line, "error: a: 2 more of the results failed, too");
    }

    #[test]
    fn photographs_outside_of_a_data_set_name_the_flag() {
        let error = |outside| {
            let (path, kind, skipped) = ("a".into(), "COLMAP", vec!["no image file".to_owned()]);
            Failure::from(gs_io::Error::NoViews { path, kind, found: 2, skipped, outside })
        };
        assert!(error(true).message().contains("--allow-outside") && !error(false).message().contains("--allow"));
    }

    #[test]
    fn a_broken_pipe_is_no_failure() {
        let pipe = Failure::output(io::Error::from(io::ErrorKind::BrokenPipe));
        assert_eq!(pipe.line(), None);
        assert_eq!(pipe.status(), ExitCode::SUCCESS);
        assert!(Failure::output(io::Error::from(io::ErrorKind::StorageFull)).line().is_some());
    }
}
