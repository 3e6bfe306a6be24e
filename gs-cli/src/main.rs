//! The program gs: fits Gaussians to images, trains 3D scenes, and renders, compares, converts and
//! inspects them.
//!
//! Results go to standard output, progress and errors to standard error. Exit status: 0 done, 1
//! failed, 2 bad usage, 130 stopped by Ctrl-C. A closed pipe on standard output is not a failure.
//!
//! Modules depend on each other in one direction: `commands` use those for training runs, fits and
//! `flags`, and these `files`, `terminal` and `failure`.

mod command_line;
mod commands;
mod failure;
mod files;
mod flags;
mod image_fit;
mod memory;
mod terminal;
mod training;

use std::process::ExitCode;

// Results have the same bits on every system.
use gs_libm as _;

use crate::{
    command_line::{Command, Parsed},
    failure::Failure,
    terminal::output,
};

fn main() -> ExitCode {
    quiet_drivers();
    match command_line::parse().and_then(run) {
        Ok(status) => status,
        Err(failure) => {
            if let Some(line) = failure.line() {
                output::note(line);
            }
            failure.status()
        }
    }
}

/// Sets the folder that Mesa's graphics drivers look for. Without it, as in containers, they write
/// a line to standard error whenever adapters are listed.
fn quiet_drivers() {
    const VARIABLE: &str = "XDG_RUNTIME_DIR";
    if cfg!(target_os = "linux") && std::env::var_os(VARIABLE).is_none() {
        // SAFETY: this is the first action of the program, which has one thread, so nothing else
        // reads the environment.
        #[expect(unsafe_code, reason = "the drivers read the environment of the process, and setting it is unsafe")]
        unsafe {
            std::env::set_var(VARIABLE, std::env::temp_dir());
        }
    }
}

fn run(parsed: Parsed) -> Result<ExitCode, Failure> {
    let command = match parsed {
        Parsed::Answered(status) => return Ok(status),
        Parsed::Command(command) => command,
    };
    match command {
        Command::Fit(args) => commands::fit::run(&args),
        Command::Encode(args) => commands::encode::run(&args),
        Command::Poses(args) => commands::poses::run(&args),
        Command::Train(args) => commands::train::run(&args),
        Command::Render(args) => commands::render::run(&args),
        Command::View(args) => commands::view::run(&args),
        Command::Page(args) => commands::page::run(&args),
        Command::Serve(args) => commands::serve::run(&args),
        Command::Eval(args) => commands::eval::run(&args),
        Command::Convert(args) => commands::convert::run(&args),
        Command::Edit(args) => commands::edit::run(&args),
        Command::Info(args) => commands::info::run(&args),
        Command::Doctor(args) => commands::doctor::run(&args),
        Command::Profile(args) => commands::price::profile::run(&args),
        Command::Effects(args) => commands::price::effects::run(&args),
        Command::Paper(args) => commands::paper::run(&args),
        Command::Popping(args) => commands::price::popping::run(&args),
        Command::Blocks(args) => commands::blocks::run(&args),
        Command::Study(args) => commands::study::run(&args),
        Command::Frontier(args) => commands::price::frontier::run(&args),
        #[cfg(feature = "manual")]
        Command::Manual(args) => commands::manual::run(&args, command_line::ungrouped),
    }?;
    Ok(ExitCode::SUCCESS)
}
