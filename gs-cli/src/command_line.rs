//! The command line: what the program understands, and one line for what it does not.

use std::process::ExitCode;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand, error::ErrorKind};

use crate::{
    commands::{
        convert::ConvertArgs, doctor::DoctorArgs, eval::EvalArgs, info::InfoArgs, popping::PoppingArgs,
        render::RenderArgs,
    },
    effects::EffectsCommandArgs,
    failure::Failure,
    fit::arguments::FitArgs,
    frontier::FrontierArgs,
    paper::PaperArgs,
    profile::ProfileArgs,
    study::arguments::StudyArgs,
    train::TrainArgs,
    view::ViewArgs,
};

const EXAMPLES: &str = "\
Examples:
  gs fit                                        the circle and square that need no file, into gs-out/
  gs fit photo.png -o out --gaussians 9000      a photograph
  gs fit photo.png -o out --quality best        the same, slower and better
  gs train photographs/ -o out                  a COLMAP, Nerfstudio or Blender data set, as 3DGS does it
  gs train photographs/ -o out --preset quick   a first look at what will come of it
  gs render out/scene.gs2d.safetensors -o big.png --size 3072x2048
  gs render out/scene.ply -o turn.apng --orbit 60   a 3D scene, all the way round
  gs view out                                   a fit or a training in a window, to move over or through
  gs eval photo.png out/reconstruction.png      PSNR, SSIM, MS-SSIM
  gs eval out photo.png                         the same of the scene of a fit
  gs eval out/scene.ply photographs/            the same of a 3D scene, view by view
  gs convert out picture.ply                    the scene of a fit for viewers of 3D Gaussian splats; .svg for browsers
  gs convert scene.ply scene.spz                a 3D scene in another format, and what that loses
  gs info out/scene.gs2d.safetensors            what is in a scene
  gs info photographs/                          what is in a COLMAP, Nerfstudio or Blender data set
  gs info --adapters                            the GPUs that were found
  gs doctor scene.ply                           what is wrong with a scene: NaN, needles, duplicates
  gs doctor scene.ply --fix -o mended.ply       the same, mended
  gs profile photo.png --backend cpu            where the time of a training step goes
  gs effects out/scene.ply photographs/         what a scene calls for, and what each effect costs
  gs profile out/scene.gs2d.safetensors --backend wgpu -o profile
  gs paper -o paper                             the paper's experiments, as a page
  gs popping scene.ply -o popping               what jumps in a scene while the camera moves, in both orders of blending
  gs frontier out/scene.ply -o frontier         what each approximation buys, on this machine
  gs frontier out/scene.ply --max-error 1/255 -o frontier   the quickest settings that keep it, for gs render --settings
  gs study absolute-vs-percentile --data photographs -o study   which policy is better, and how sure that is
  gs study replay study 17                      row 17 of its runs.csv again, the same scene bit for bit

Exit status: 0 done, 1 failed, 2 bad usage, 130 stopped by Ctrl-C.";

/// Fits Gaussians to images and to posed photographs, renders, compares, converts, inspects and profiles the results; repeats the
/// paper's experiments, and studies which way of growing is better.
#[derive(Debug, Parser)]
#[command(name = "gs", version, about, after_help = EXAMPLES, arg_required_else_help = true)]
struct CommandLine {
    #[command(subcommand)]
    command: Command,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Turn an image into Gaussians
    Fit(Box<FitArgs>),
    /// Turn posed photographs into a 3D scene
    Train(Box<TrainArgs>),
    /// Draw a scene as a PNG of any size, or from moving cameras
    Render(Box<RenderArgs>),
    /// Show a scene in a window: pan and zoom a 2D scene, move through a 3D scene
    View(Box<ViewArgs>),
    /// Compare two images, or a scene with its image or images: PSNR, SSIM, L1
    Eval(Box<EvalArgs>),
    /// Turn a 3D scene into another format (PLY, .splat, SPZ, glTF), or a 2D scene into a flat PLY or an SVG
    Convert(Box<ConvertArgs>),
    /// Tell what is in a scene, a checkpoint or a data set, or which GPUs there are
    Info(InfoArgs),
    /// Tell what is wrong with a scene, and mend it
    Doctor(DoctorArgs),
    /// Tell where the time of a training step goes, stage by stage
    Profile(Box<ProfileArgs>),
    /// Tell which effects a scene calls for, and what each one costs and changes
    Effects(Box<EffectsCommandArgs>),
    /// Repeat the paper's experiments, and set what it says beside what is measured
    Paper(Box<PaperArgs>),
    /// Tell how much jumps in a 3D scene while the camera moves, by either order of blending
    Popping(Box<PoppingArgs>),
    /// Tell what accuracy costs in time, and choose settings that keep a budget of either
    Frontier(Box<FrontierArgs>),
    /// Compare density policies over images, budgets and seeds, with intervals and a report
    Study(Box<StudyArgs>),
}

/// What became of the command line.
pub(crate) enum Parsed {
    /// A command to carry out.
    Command(Command),
    /// Help or the version was asked for and has been printed.
    Answered(ExitCode),
}

/// Reads the program's command line.
///
/// # Errors
/// Bad usage, in one line.
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
            Err(Failure::usage(essence(&error.to_string())).mend(format_args!("see {help}")))
        }
    }
}

/// The command line, with "-5" taken for the value of a flag and not for a flag of its own, so that what is wrong with it is said.
fn command() -> clap::Command {
    fn with_negative_numbers(command: clap::Command) -> clap::Command {
        let takes_value = |arg: &clap::Arg| arg.get_action().takes_values() && !arg.is_positional();
        let command = command.mut_args(|arg| if takes_value(&arg) { arg.allow_negative_numbers(true) } else { arg });
        command.mut_subcommands(with_negative_numbers)
    }
    with_negative_numbers(CommandLine::command())
}

const COMMANDS: [&str; 14] = [
    "fit", "train", "render", "view", "eval", "convert", "info", "doctor", "profile", "effects", "paper", "popping",
    "frontier", "study",
];

/// The parser's message without its usage, its pointers to the help and to `--`, and its own "error:".
fn essence(message: &str) -> String {
    let paragraphs = message.split("\n\n").map(str::trim);
    // That a word could also be given behind `--` helps nobody who has misspelt a flag.
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
    fn a_flag_that_does_not_exist_is_not_said_to_be_a_value() {
        let error = command().try_get_matches_from(["gs", "fit", "--turbo"]).unwrap_err();
        assert_eq!(essence(&error.to_string()), "unexpected argument '--turbo' found");
    }

    #[test]
    fn of_the_parsers_message_the_essence_stays() {
        let message = "error: invalid value 'x' for '--policy <P>'\n  [possible values: a, b]\n\n  tip: try a\n\nUsage: gs fit\n\nFor more information, try '--help'.\n";
        assert_eq!(essence(message), "invalid value 'x' for '--policy <P>'\n  [possible values: a, b]: tip: try a");
    }
}
