//! The command line: its commands and the help of the program. An error is one line.

use std::process::ExitCode;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand, error::ErrorKind};

use crate::{
    commands::{
        convert::ConvertArgs, doctor::DoctorArgs, effects::EffectsCommandArgs, encode::EncodeArgs, eval::EvalArgs,
        fit::FitArgs, frontier::FrontierArgs, info::InfoArgs, page::PageArgs, paper::PaperArgs, popping::PoppingArgs,
        profile::ProfileArgs, render::RenderArgs, serve::ServeArgs, study::StudyArgs, train::TrainArgs, view::ViewArgs,
    },
    failure::Failure,
    help,
};

const EXAMPLES: &str = "\
Examples:
  gs fit
      fit Gaussians to a built-in image, into gs-out/
  gs fit photo.png -o out -n 9000
      fit 9000 Gaussians to an image; --preset best takes longer and is better
  gs render out -o big.png --size 3072x2048
      render the result at another size
  gs encode photo.png -o photo.gsi --bpp 0.5
      compress an image; gs decode photo.gsi -o photo.png makes a PNG of it
  gs encode photos/ -o compressed --quality 70
      compress all images of a folder
  gs eval photo.png out/reconstruction.png
      compare two images by PSNR, SSIM and MS-SSIM
  gs convert out picture.ply
      make a file for splat viewers of a fit
  gs info images/
      show what is in a COLMAP, Nerfstudio or Blender data set
  gs train images/ -o out
      train a 3D scene; --preset 3dgs does it as published
  gs view out
      show a scene in a window
  gs page out -o scene.html
      make one page of it that every browser opens
  gs render out -o turn.apng --orbit 60
      render a 3D scene from all sides
  gs eval out images/
      measure PSNR, SSIM and L1 over the test views
  gs convert out scene.spz
      convert a 3D scene to another format, and show what is lost
  gs doctor scene.ply --fix -o fixed.ply
      find and repair broken Gaussians
  gs info --adapters
      list the GPUs of this machine
  gs frontier out --max-error 1/255 -o frontier
      find the fastest settings for an accuracy, for gs render --settings
  gs study absolute-vs-percentile --data images/ -o study
      compare density policies

A scene is a scene file, a checkpoint, or the output folder of gs fit or gs train.

Exit status: 0 done, 1 failed, 2 bad usage, 130 stopped by Ctrl-C.";

/// Gaussian splatting: fits Gaussians to images, trains 3D scenes from posed images, and renders,
/// views, compares and converts the results
#[derive(Debug, Parser)]
#[command(name = "gs", version, after_help = EXAMPLES, arg_required_else_help = true)]
struct CommandLine {
    #[command(subcommand)]
    command: Command,
}

/// A command.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Fit Gaussians to images
    Fit(Box<FitArgs>),
    /// Compress images as .gsi files
    Encode(Box<EncodeArgs>),
    /// Train a 3D scene from posed images
    Train(Box<TrainArgs>),
    /// Render a scene as a PNG of any size, or from moving cameras
    #[command(visible_alias = "decode")]
    Render(Box<RenderArgs>),
    /// Show a scene in a window
    View(Box<ViewArgs>),
    /// Write a scene and a viewer as one page for browsers
    Page(PageArgs),
    /// Show the scenes and runs of a folder in a browser, also over ssh
    Serve(ServeArgs),
    /// Compare two images, or a scene with its image or data set: PSNR, SSIM, L1
    Eval(Box<EvalArgs>),
    /// Convert a 3D scene to PLY, .splat, SPZ, SOG or glTF, or a 2D scene to a flat PLY or an SVG
    Convert(Box<ConvertArgs>),
    /// Show what is in a scene, a checkpoint or a data set, or list the GPUs
    Info(InfoArgs),
    /// Find broken Gaussians in a scene, and repair them
    Doctor(DoctorArgs),
    /// Measure the time of a training step, stage by stage
    Profile(Box<ProfileArgs>),
    /// Show which effects a scene requires, and what each one costs and changes
    Effects(Box<EffectsCommandArgs>),
    /// Repeat the paper's experiments, and compare its claims with measurements
    Paper(Box<PaperArgs>),
    /// Measure how much a 3D scene flickers while the camera moves, in both orders of blending
    Popping(Box<PoppingArgs>),
    /// Measure what accuracy costs in time, and choose settings for a budget of either
    Frontier(Box<FrontierArgs>),
    /// Compare density policies over images, budgets and seeds, with intervals and a report
    Study(Box<StudyArgs>),
}

/// The parsed command line.
pub(crate) enum Parsed {
    /// A command to carry out.
    Command(Command),
    /// Help or the version was printed.
    Answered(ExitCode),
}

/// Reads the program's command line.
pub(crate) fn parse() -> Result<Parsed, Failure> {
    let read = command().try_get_matches().and_then(|matches| CommandLine::from_arg_matches(&matches));
    let error = match read {
        Ok(line) => return Ok(Parsed::Command(line.command)),
        Err(error) => error,
    };
    match error.kind() {
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion => {
            error.print().map_err(Failure::output)?;
            Ok(Parsed::Answered(ExitCode::SUCCESS))
        }
        ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            error.print().map_err(Failure::output)?;
            Ok(Parsed::Answered(ExitCode::from(2)))
        }
        _ => {
            let command = std::env::args().nth(1).filter(|word| COMMANDS.contains(&word.as_str()));
            let help = command.map_or_else(|| "gs --help".to_owned(), |command| format!("gs {command} --help"));
            Err(Failure::usage(essence(&error.to_string())).hint(format_args!("see {help}")))
        }
    }
}

/// The command line. "-5" is the value of a flag rather than a flag, so that the error says what is
/// wrong with the number.
fn command() -> clap::Command {
    fn with_negative_numbers(command: clap::Command) -> clap::Command {
        let takes_value = |arg: &clap::Arg| arg.get_action().takes_values() && !arg.is_positional();
        let command = command.mut_args(|arg| if takes_value(&arg) { arg.allow_negative_numbers(true) } else { arg });
        command.mut_subcommands(with_negative_numbers)
    }
    let command = with_negative_numbers(CommandLine::command());
    let command = command.mut_subcommands(|command| match command.get_name() {
        "convert" => command.mut_args(requires_dataset),
        _ => command,
    });
    help::wrapped(command)
}

/// The flag with the requirement of `--dataset` or of drawing, if it only acts with that.
fn requires_dataset(arg: clap::Arg) -> clap::Arg {
    let name = arg.get_id().as_str();
    if FOR_DATASET.contains(&name) {
        arg.requires("dataset")
    } else if FOR_DRAWING.contains(&name) {
        arg.requires("drawn")
    } else {
        arg
    }
}

/// The flags of `gs convert` that only act where it draws: with `--dataset` or `--gaussians`.
const FOR_DRAWING: [&str; 4] = ["backend", "adapter", "threads", "simd"];

/// The flags of `gs convert` that only act with `--dataset`.
const FOR_DATASET: [&str; 7] = ["holdout", "images", "alpha", "max_size", "allow_outside", "background", "sh_degree"];

const COMMANDS: [&str; 17] = [
    "fit", "encode", "train", "render", "view", "page", "serve", "eval", "convert", "info", "doctor", "profile",
    "effects", "paper", "popping", "frontier", "study",
];

/// The parser's message without its usage, its pointers to the help and to `--`, and its own
/// "error:".
fn essence(message: &str) -> String {
    let paragraphs = message.split("\n\n").map(str::trim);
    // The tip about `--` does not help with a misspelt flag.
    let left_out = ["Usage:", "For more information", "tip: to pass"];
    let kept = paragraphs.filter(|p| !p.is_empty() && !left_out.iter().any(|beginning| p.starts_with(beginning)));
    let text = kept.collect::<Vec<_>>().join(": ");
    text.strip_prefix("error: ").unwrap_or(&text).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        command().debug_assert();
        let known: Vec<_> = command().get_subcommands().map(|c| c.get_name().to_owned()).collect();
        assert_eq!(known, COMMANDS);
    }

    #[test]
    fn an_unknown_flag_has_no_tip() {
        let error = command().try_get_matches_from(["gs", "fit", "--turbo"]).unwrap_err();
        assert_eq!(essence(&error.to_string()), "unexpected argument '--turbo' found");
    }

    #[test]
    fn the_essence_of_a_message_is_kept() {
        let message = "error: invalid value 'x' for '--policy <P>'\n  [possible values: a, b]\n\n  tip: try a\n\nUsage: gs fit\n\nFor more information, try '--help'.\n";
        assert_eq!(essence(message), "invalid value 'x' for '--policy <P>'\n  [possible values: a, b]: tip: try a");
    }
}
