//! The project's own commands: `cargo xtask test` runs all the tests.
//!
//! This program depends on no crate, so that it compiles within a second on a fresh machine.

mod test;

use std::process::ExitCode;

use crate::test::Options;

const HELP: &str = "\
Runs the tests of the workspace, documentation tests included.

Usage: cargo xtask test [--install] [--slow]

Options:
  --install  install what the tests need: Mesa's software Vulkan driver, where there is no
             graphics adapter. Without it nothing is installed, and tests that need an
             adapter are skipped and listed by name
  --slow     then run the slow tests (marked #[ignore]) in the release profile

Tests on real images and scenes read the folder that GS_DATA names, ../shared/data by default.
They pass without checking anything where it is absent.";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let options = match &words[..] {
        [] | ["help" | "-h" | "--help"] | ["test", "-h" | "--help"] => {
            eprintln!("{HELP}");
            return ExitCode::SUCCESS;
        }
        ["test", flags @ ..] => Options::parse(flags),
        [other, ..] => Err(format!("unknown command {other}")),
    };
    let options = match options {
        Ok(options) => options,
        Err(message) => {
            eprintln!("error: {message}: see cargo xtask help");
            return ExitCode::from(2);
        }
    };
    match test::run(options) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("error: {message}");
            ExitCode::FAILURE
        }
    }
}
