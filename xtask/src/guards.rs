//! `cargo xtask guards`: without a guard of the arithmetic, what `docs/guards.md` names beside it fails.
//!
//! The test is built with `--cfg guards="can-be-off"`, by which guards can be switched off while it runs.

use crate::{test, wrapper};

/// Builds and runs the test; fails where a guard is not noticed.
pub(crate) fn run() -> Result<(), String> {
    test::prepare()?;
    let environment = wrapper::environment(r#"guards="can-be-off""#)?;
    let arguments = ["test", "--package", "gs-conformance", "--test", "guards", "--", "--nocapture"];
    test::cargo_with(&arguments, |cargo| cargo.envs(environment))
}
