//! The program gs: fits Gaussians to an image, renders them at any size, and compares and inspects the results; converts 3D scenes.
//!
//! Standard output carries what was asked for, and nothing else; progress and errors go to standard error. Exit status: 0 done,
//! 1 failed, 2 bad usage, 130 stopped by Ctrl-C; a reader that closes our output early is no failure.

mod backend;
mod cameras;
mod chosen;
mod chosen_machine;
mod command_line;
mod commands;
mod dataset;
mod effects;
mod failure;
mod fit;
mod frontier;
mod interrupt;
mod memory;
mod opened;
mod output;
mod output_folder;
mod paper;
mod profile;
mod settings_file;
mod shown;
mod study;
mod text_file;
mod train;
mod training_arguments;
mod values;
mod view;

use std::process::ExitCode;

use crate::{
    command_line::{Command, Parsed},
    failure::Failure,
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

/// Gives Mesa's graphics drivers the folder that they look for. Where there is none, as in containers, each look at the adapters makes them
/// write a line to standard error.
fn quiet_drivers() {
    const VARIABLE: &str = "XDG_RUNTIME_DIR";
    if cfg!(target_os = "linux") && std::env::var_os(VARIABLE).is_none() {
        // SAFETY: this is the first thing that the program does: it has one thread, so nobody reads the environment meanwhile.
        #[expect(unsafe_code, reason = "the drivers read the environment of the process, and setting it is unsafe")]
        unsafe {
            std::env::set_var(VARIABLE, std::env::temp_dir());
        }
    }
}

fn run(parsed: Parsed) -> Result<ExitCode, Failure> {
    match parsed {
        Parsed::Answered(status) => return Ok(status),
        Parsed::Command(Command::Fit(args)) => fit::run(&args),
        Parsed::Command(Command::Train(args)) => train::run(&args),
        Parsed::Command(Command::Render(args)) => commands::render::run(&args),
        Parsed::Command(Command::View(args)) => view::run(&args),
        Parsed::Command(Command::Eval(args)) => commands::eval::run(&args),
        Parsed::Command(Command::Convert(args)) => commands::convert::run(&args),
        Parsed::Command(Command::Info(args)) => commands::info::run(&args),
        Parsed::Command(Command::Doctor(args)) => commands::doctor::run(&args),
        Parsed::Command(Command::Profile(args)) => profile::run(&args),
        Parsed::Command(Command::Effects(args)) => effects::run(&args),
        Parsed::Command(Command::Paper(args)) => paper::run(&args),
        Parsed::Command(Command::Popping(args)) => commands::popping::run(&args),
        Parsed::Command(Command::Study(args)) => study::run(&args),
        Parsed::Command(Command::Frontier(args)) => frontier::run(&args),
    }?;
    Ok(ExitCode::SUCCESS)
}
