//! The command line: its commands and the help of the program. An error is one line.

mod defaults;

use std::process::ExitCode;

use clap::{
    CommandFactory, FromArgMatches, Parser, Subcommand,
    error::{ContextKind, ContextValue, ErrorKind},
};
use gs_density::Policy;

use crate::{
    commands::{
        blocks::BlocksArgs,
        convert::ConvertArgs,
        doctor::DoctorArgs,
        edit::EditArgs,
        encode::EncodeArgs,
        eval::EvalArgs,
        fit::FitArgs,
        info::InfoArgs,
        page::PageArgs,
        paper::PaperArgs,
        poses::PosesArgs,
        price::{effects::EffectsCommandArgs, frontier::FrontierArgs, popping::PoppingArgs, profile::ProfileArgs},
        render::RenderArgs,
        serve::ServeArgs,
        study::StudyArgs,
        train::TrainArgs,
        view::ViewArgs,
    },
    failure::Failure,
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
  gs info images/
      show what is in a COLMAP, Nerfstudio or Blender data set
  gs poses photos/ -o images
      find the camera poses of photographs or a video, by COLMAP
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
  gs edit out room.ply up=ground crop=sphere:0,0,0,4
      turn a scene so that its ground is level, and remove what is far away
  gs doctor scene.ply
      find broken Gaussians; gs convert scene.ply fixed.ply --drop-broken repairs the scene
  gs info --adapters
      list the GPUs of this machine
  gs frontier out -o frontier
      measure what each approximation costs in time and error
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
    /// Make a data set of photographs or a video, with poses by COLMAP
    Poses(Box<PosesArgs>),
    /// Train a 3D scene from posed images, photographs or a video
    Train(Box<TrainArgs>),
    /// Train a large 3D scene in blocks, on any number of machines
    Blocks(Box<BlocksArgs>),
    /// Render a scene at any size, or from moving cameras
    #[command(visible_alias = "decode")]
    Render(Box<RenderArgs>),
    /// Show a scene in a window
    View(Box<ViewArgs>),
    /// Write a scene and a viewer as one page for browsers
    Page(PageArgs),
    /// Show the scenes and runs of a folder in a browser, also over ssh
    Serve(ServeArgs),
    /// Compare two images, or a scene with its image or data set
    Eval(Box<EvalArgs>),
    /// Convert a 3D scene to another format, or a .gsi file to a 2D scene
    Convert(Box<ConvertArgs>),
    /// Move, turn, scale, crop, filter or join 3D scenes
    Edit(Box<EditArgs>),
    /// Show what is in a scene, checkpoint or data set, or list the GPUs
    Info(Box<InfoArgs>),
    /// Find broken Gaussians in a scene
    Doctor(DoctorArgs),
    /// Measure the time of a training step, stage by stage
    Profile(Box<ProfileArgs>),
    /// Show which effects a scene requires, and what each one costs
    Effects(Box<EffectsCommandArgs>),
    /// Measure what accuracy costs in time
    Frontier(Box<FrontierArgs>),
    /// Measure how much a 3D scene flickers while the camera moves
    Popping(Box<PoppingArgs>),
    /// Compare density policies over images, budgets and seeds
    Study(Box<StudyArgs>),
    /// Repeat the paper's experiments, and check its claims
    Paper(Box<PaperArgs>),
    /// Write the man pages and the completions of shells
    #[cfg(feature = "manual")]
    #[command(hide = true)]
    Manual(crate::commands::manual::ManualArgs),
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
            let is_command = |word: &String| GROUPS.iter().any(|(_, names)| names.contains(&word.as_str()));
            let command = std::env::args().nth(1).filter(is_command);
            let command = command.map_or_else(|| "gs".to_owned(), |command| format!("gs {command}"));
            let of_policy = policy_refusal(&error, &command);
            Err(Failure::usage(of_policy.unwrap_or_else(|| refusal(&error.to_string(), &format!("{command} --help")))))
        }
    }
}

/// The command line, with the commands in groups.
fn command() -> clap::Command {
    let command = ungrouped();
    let list = grouped(&command);
    command.help_template(format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{list}\n\nOptions:\n{{options}}{{after-help}}"
    ))
}

/// The command line. "-5" is the value of a flag rather than a flag, so that the error says what is
/// wrong with the number.
pub(crate) fn ungrouped() -> clap::Command {
    fn with_negative_numbers(command: clap::Command) -> clap::Command {
        let takes_value = |arg: &clap::Arg| arg.get_action().takes_values() && !arg.is_positional();
        let command = command.mut_args(|arg| if takes_value(&arg) { arg.allow_negative_numbers(true) } else { arg });
        command.mut_subcommands(with_negative_numbers)
    }
    let command = with_negative_numbers(CommandLine::command());
    command.mut_subcommands(|command| match command.get_name() {
        "convert" => command.mut_args(requires_dataset),
        "fit" => command.mut_args(defaults::of_fit),
        "train" => command.mut_args(defaults::of_train),
        _ => command,
    })
}

/// The list of commands, in groups.
fn grouped(command: &clap::Command) -> String {
    let entry = |name: &&str| {
        let found = command.find_subcommand(name);
        let about = found.and_then(clap::Command::get_about).map(ToString::to_string).unwrap_or_default();
        let aliases = found.into_iter().flat_map(clap::Command::get_visible_aliases);
        let aliases: String = aliases.map(|alias| format!(" [alias: {alias}]")).collect();
        format!("  {name:<8}  {about}{aliases}")
    };
    let group = |(heading, names): &(&str, &[&str])| {
        format!("{heading}:\n{}", names.iter().map(entry).collect::<Vec<_>>().join("\n"))
    };
    GROUPS.iter().map(group).collect::<Vec<_>>().join("\n\n")
}

/// The flag with the requirement of `--dataset` or `--gaussians`, if it only acts with that.
fn requires_dataset(arg: clap::Arg) -> clap::Arg {
    let name = arg.get_id().as_str();
    if FOR_DATASET.contains(&name) {
        arg.requires("dataset")
    } else if FOR_DRAWING.contains(&name) {
        arg.requires("gaussians")
    } else {
        arg
    }
}

/// The flags of `gs convert` that only act where it draws: with `--gaussians`.
const FOR_DRAWING: [&str; 4] = ["backend", "adapter", "threads", "simd"];

/// The flags of `gs convert` that only act with `--dataset`.
const FOR_DATASET: [&str; 7] = ["holdout", "images", "alpha", "max_size", "allow_outside", "background", "sh_degree"];

/// The commands, in the groups and the order of docs/guide.md.
const GROUPS: [(&str, &[&str]); 7] = [
    ("Images", &["fit", "encode"]),
    ("3D scenes", &["poses", "train", "blocks"]),
    ("Looking at scenes", &["render", "view", "page", "serve"]),
    ("Quality", &["eval"]),
    ("Files", &["convert", "edit", "info", "doctor"]),
    ("Cost", &["profile", "effects", "frontier", "popping"]),
    ("Studies", &["study", "paper"]),
];

/// The message for a density-control policy of the other kind of scenes, which is no misspelling; `None` for
/// any other error.
fn policy_refusal(error: &clap::Error, command: &str) -> Option<String> {
    let (Some(ContextValue::String(flag)), Some(ContextValue::String(name)), Some(ContextValue::Strings(possible))) =
        (error.get(ContextKind::InvalidArg), error.get(ContextKind::InvalidValue), error.get(ContextKind::ValidValue))
    else {
        return None;
    };
    let policy = Policy::from_name(name).ok().filter(|_| flag.starts_with("--policy"))?;
    let (scenes, trainer) = if policy.validate_2d().is_ok() { ("images", "gs fit") } else { ("3D scenes", "gs train") };
    let possible = possible.join(", ");
    Some(format!("--policy {name} is a policy for {scenes}, which {trainer} takes; {command} takes {possible}"))
}

/// The parser's message as one line that ends with this command for help: without its usage, its
/// pointer to `--`, and its own "error:"; "tip: a similar argument exists" becomes a question.
fn refusal(message: &str, help: &str) -> String {
    let lines = message.lines().map(str::trim).take_while(|line| !line.starts_with("Usage:"));
    let lines = lines.filter(|line| !line.is_empty() && !line.starts_with("For more information"));
    let (tips, text): (Vec<&str>, Vec<&str>) = lines.partition(|line| line.starts_with("tip: "));
    let text = text.join(" ");
    let text = text.strip_prefix("error: ").unwrap_or(&text);
    // The tip about `--` does not help with a misspelt flag.
    let similar =
        tips.iter().filter(|tip| tip.contains("similar")).find_map(|tip| tip.split_once("exist")?.1.split_once(": "));
    match similar {
        Some((_, names)) => format!("{text}; did you mean {}? (see {help})", names.replace(", ", " or ")),
        None => format!("{text}; see {help}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        command().debug_assert();
        let command = command();
        let known: Vec<_> = command.get_subcommands().filter(|c| !c.is_hide_set()).map(|c| c.get_name()).collect();
        assert_eq!(known, GROUPS.iter().flat_map(|(_, names)| *names).copied().collect::<Vec<_>>());
    }

    /// The help of a command, as with `--help`.
    fn help_of(words: &[&str]) -> String {
        let line = ["gs"].iter().chain(words).chain(&["--help"]);
        command().try_get_matches_from(line).unwrap_err().to_string()
    }

    #[test]
    fn commands_are_listed_in_the_groups_of_the_guide() {
        let help = help_of(&[]);
        let guide = include_str!("../../../docs/guide.md");
        let mut from = (0, 0);
        for (heading, names) in GROUPS {
            let places = (help.find(&format!("\n{heading}:\n")), guide.find(&format!("\n## {heading}\n")));
            let (Some(place), Some(in_guide)) = places else { panic!("{heading}: {help}") };
            assert!(place > from.0 && in_guide > from.1, "{heading}: {help}");
            from = (place, in_guide);
            assert!(names.iter().all(|name| help.contains(&format!("\n  {name:<8}  "))), "{help}");
        }
        assert!(help.contains("--version") && help.contains("Examples:"), "{help}");
    }

    /// The parser breaks lines of texts between words, but not those of a template.
    #[test]
    fn the_list_of_commands_fits_into_80_columns() {
        let list = grouped(&command());
        for line in list.lines() {
            assert!(line.chars().count() <= 80, "{line}");
        }
    }

    #[test]
    fn the_help_has_the_defaults_of_the_presets() {
        let (fit, train) = (help_of(&["fit"]), help_of(&["train"]));
        let has = |help: &str, default: &str| {
            let words = help.split_whitespace().collect::<Vec<_>>().join(" ");
            assert!(words.contains(default), "{default}: {words}");
        };
        has(&fit, "Loss to minimise [default: l2; paper: l1-dssim]");
        has(&fit, "0 keeps the initial Gaussians [default: 400; quick: 50, best: 1500, paper: 2500]");
        has(&fit, "initial Gaussians [default: gradient; paper: random]");
        has(&fit, "become its colour [default: sum; paper: over]");
        has(&train, "Loss to minimise [default: l1-dssim");
        has(&train, "spherical harmonics (SH), 0 to 3 [default: 3");
        has(&train, "Order of blending [default: global]");
        has(&train, "1, 2, 4 or 8 [default: 2; 3dgs and mcmc: 1]");
        for (help, command) in [(&fit, "fit"), (&train, "train")] {
            assert!(!help.contains("[default: ;") && !help.contains("[default: ]"), "{command}: {help}");
        }
    }

    #[test]
    fn help_speaks_of_its_own_command() {
        let (fit, train, encode) = (help_of(&["fit"]), help_of(&["train"]), help_of(&["encode"]));
        assert!(!fit.contains("fastgs") && fit.contains("needs --blend over"), "{fit}");
        assert!(!train.contains("--blend") && !train.contains("only in gs train"), "{train}");
        assert!(!encode.contains("loss l"), "{encode}");
    }

    #[test]
    fn flags_stand_under_headings_that_fit_them() {
        let heading = |name: &str, flag: &str| {
            let command = command();
            let mut args = command.find_subcommand(name).unwrap().get_arguments();
            args.find(|arg| arg.get_long() == Some(flag)).unwrap().get_help_heading().map(str::to_owned)
        };
        for name in ["fit", "train", "render", "view"] {
            assert_eq!(heading(name, "effects").as_deref(), Some("Rendering"), "{name}");
        }
    }

    #[test]
    fn a_policy_of_the_other_kind_of_scenes_is_said_to_be_one() {
        let refused = |command: &str, policy: &str| {
            let error = command_line_error(&[command, "a", "--policy", policy]);
            policy_refusal(&error, &format!("gs {command}"))
        };
        let message = refused("fit", "fastgs").unwrap();
        let start = "--policy fastgs is a policy for 3D scenes, which gs train takes; gs fit takes absolute, ";
        assert!(message.starts_with(start) && message.ends_with(", none") && !message.contains("mrnf"), "{message}");
        let message = refused("train", "residual").unwrap();
        let start = "--policy residual is a policy for images, which gs fit takes; gs train takes absolute, ";
        assert!(message.starts_with(start) && message.contains("mrnf"), "{message}");
        assert_eq!(refused("fit", "fastergs"), None);
        assert_eq!(policy_refusal(&command_line_error(&["fit", "--loss", "mcmc"]), "gs fit"), None);
    }

    fn command_line_error(words: &[&str]) -> clap::Error {
        command().try_get_matches_from(["gs"].iter().chain(words)).unwrap_err()
    }

    #[test]
    fn a_resumed_training_has_the_settings_of_its_checkpoint() {
        for flag in [&["--seed", "1"][..], &["--exactly"], &["--preset", "quick"], &["--effects", "all"]] {
            let error = command_line_error(&[&["train", "x", "--resume", "a"], flag].concat()).to_string();
            assert!(error.contains(flag[0]) && error.contains("cannot be used with"), "{error}");
        }
    }

    #[test]
    fn a_refused_value_names_what_is_possible() {
        for (words, expected) in [
            (&["fit", "-n", "-5"][..], "invalid value '-5' for '--gaussians <N>': must be at least 1; see gs X --help"),
            (&["fit", "-n", "0"], "must be at least 1"),
            (&["fit", "-n", "1e9"], "must be a whole number"),
            (&["fit", "--iterations", "-1"], "'--iterations <K>': must be at least 0"),
            (&["fit", "--init", "nowhere"], "possible values: random"),
            (&["fit", "--loss", "l3"], "possible values: l2"),
            (&["fit", "--blend", "under"], "possible values: sum"),
            (&["fit", "--preset", "worst"], "possible values: paper"),
            (&["fit", "--backend", "cuda"], "possible values: auto, cpu, wgpu"),
            (&["fit", "--adapter", ""], "--adapter"),
            (&["fit", "--threads", "0"], "must be from 1 to 1024"),
            (&["fit", "--threads", "4000000000"], "must be from 1 to 1024"),
            (&["fit", "--background", "1,2,3"], "from 0 to 1"),
            (&["fit", "--seed", "minus one"], "must be a whole number"),
            (&["train", "x", "--sh-degree", "-2"], "must be from 0 to 3"),
            (&["train", "x", "--max-size", "0"], "'--max-size <PX>': must be at least 1 px, such as 1600, or none"),
            (&["render", "x", "-o", "y", "--region", "0,0,0,9"], "X,Y,WIDTH,HEIGHT"),
            (&["render", "x", "-o", "y", "--camera", "nowhere"], "DATASET:VIEW"),
            (&["render", "x", "-o", "y", "--up", "w"], "write x, y, z"),
            (&["convert", "x", "y", "--spz-version", "5"], "possible values: 3, 4"),
            (&["study", "x", "--jobs", "0"], "--jobs"),
            (&["study", "work", "x", "--threads", "-1"], "must be from 1 to 1024"),
            (&["profile", "--size", "0x5"], "WIDTHxHEIGHT"),
            (&["profile", "--repetitions", "0"], "must be from 1 to 100000"),
            (&["effects", "x", "--views", "0"], "must be from 1 to 10000"),
            (&["effects", "x", "--train", "12"], "<DATASET>"),
            (&["popping", "x", "--frames", "3"], "must be from 9 to 10000"),
        ] {
            let line = refusal(&command_line_error(words).to_string(), "gs X --help");
            assert!(line.contains(expected) && !line.contains("tip: "), "{words:?}: {line}");
        }
    }

    #[test]
    fn refusals_are_one_line_without_chains_of_colons() {
        for (words, expected) in [
            (&["fit", "--turbo"][..], "unexpected argument '--turbo' found; see gs X --help"),
            (
                &["fit", "--gausians", "5"],
                "unexpected argument '--gausians' found; did you mean '--gaussians'? (see gs X --help)",
            ),
            (
                &["fit", "--loss", "l1-dsim"],
                "invalid value 'l1-dsim' for '--loss <LOSS>' [possible values: l2, l1, l1-dssim]; did you mean 'l1-dssim'? (see gs X --help)",
            ),
            (&["fitt"], "unrecognized subcommand 'fitt'; did you mean 'fit'? (see gs X --help)"),
            (
                &["render", "a", "-o", "b", "--size", "3"],
                "invalid value '3' for '--size <WxH>': write it as WIDTHxHEIGHT in whole pixels, such as 1536x1024; see gs X --help",
            ),
            (
                &["encode", "a"],
                "the following required arguments were not provided: --output <OUTPUT>; see gs X --help",
            ),
        ] {
            let error = command_line_error(words);
            assert_eq!(refusal(&error.to_string(), "gs X --help"), expected, "{words:?}");
        }
    }
}
