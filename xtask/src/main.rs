//! The chores of this project. It uses no crate, so that it compiles in a second on a fresh machine.

mod miri;
mod test;

use std::process::ExitCode;

const HELP: &str = "\
The chores of this project.

Usage: cargo xtask test [--slow]
       cargo xtask miri

  test          run every test of the workspace, documentation tests included, and install first what they need
  test --slow   then also run the slow tests (marked #[ignore]), in the release profile
  miri          run property tests and others under Miri, which sees undefined behaviour in what the libraries rest on
  help          print this";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let outcome = match words[..] {
        ["test"] => test::run(test::Scope::Ordinary),
        ["test", "--slow"] => test::run(test::Scope::AlsoSlow),
        ["miri"] => miri::run(),
        [] | ["help" | "-h" | "--help"] => {
            eprintln!("{HELP}");
            return ExitCode::SUCCESS;
        }
        _ => {
            eprintln!("error: unknown chore: cargo xtask {}: see cargo xtask help", words.join(" "));
            return ExitCode::from(2);
        }
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("error: {message}");
            ExitCode::FAILURE
        }
    }
}
