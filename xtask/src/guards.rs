//! `cargo xtask guards`: without a guard of the arithmetic, what `docs/guards.md` names beside it fails.
//!
//! The test is built with `--cfg guards="can-be-off"`, by which guards can be switched off while it runs. Flags for all crates would compile those of
//! others again; so this program stands between cargo and rustc, as clippy does, and adds it where the crate is one of this workspace.

use std::{
    env,
    process::{Command, ExitCode},
};

use crate::test;

/// Set where this program is rustc's wrapper.
const WRAPS: &str = "XTASK_WRAPS_RUSTC";

/// Builds and runs the test; fails where a guard is not noticed.
pub(crate) fn run() -> Result<(), String> {
    test::prepare()?;
    let own = env::current_exe().map_err(|source| format!("this program does not know where it is: {source}"))?;
    let arguments = ["test", "--package", "gs-conformance", "--test", "guards", "--", "--nocapture"];
    test::cargo_with(&arguments, |cargo| cargo.env("RUSTC_WORKSPACE_WRAPPER", own).env(WRAPS, "1"))
}

/// What cargo asks rustc for, where this program is its wrapper: the first argument is rustc.
pub(crate) fn compile() -> Option<ExitCode> {
    env::var_os(WRAPS)?;
    let mut words = env::args_os().skip(1);
    let rustc = words.next()?;
    let status = Command::new(&rustc).args(words).args(["--cfg", r#"guards="can-be-off""#]).status();
    Some(match status {
        Ok(status) if status.success() => ExitCode::SUCCESS,
        Ok(_) => ExitCode::FAILURE,
        Err(source) => {
            eprintln!("error: {}: could not be started: {source}", rustc.display());
            ExitCode::FAILURE
        }
    })
}
