//! The flags of `gs fit`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use gs_io::{FolderClaim, Inputs};

use crate::{
    backend::BackendArgs,
    effects::choice::EffectsArgs,
    output::Format,
    output_folder::OverwriteArgs,
    training_arguments::{AntialiasName, CheckpointArgs, Detail, LossName, ParameterizationName, PolicyName},
    values::{Color, whole},
};

const AFTER_HELP: &str = "\
DIR then holds:
  reconstruction.png      the Gaussians rendered at the image's size
  scene.gs2d.safetensors  the Gaussians themselves, for gs view, gs render, gs convert and gs info
  scene.ply               with --blend over: Gaussians in a plane that any viewer of 3D Gaussian splats shows as the
                          reconstruction; gs convert makes such a file of every scene
  ellipses.png            the Gaussians drawn as ellipses over the reconstruction; of many, those that matter most
  metrics.csv             count, edits and loss at every 100th part of the steps and at each round of density
                          control; at every 20th part and at both ends also L1, PSNR, what was culled and what was
                          clamped, which cost a rendering; rows come as the fit goes on, in metrics.part.csv until it
                          ends well
  curve.png               count, loss and PSNR over the steps
  settings.toml           all settings, to repeat the fit with --settings
  summary.json            what --json prints

Files that earlier runs of gs wrote into DIR are replaced, or removed if this fit does not write them; checkpoints stay. The list of these
files is DIR/.gs-files.json. If any other file has the name of a result, the fit does not start; --overwrite replaces it. Two runs cannot write into
one folder at once.

Transparent pixels are fitted as they look on white or on --background; with --blend over that colour is also what lies behind all
Gaussians, in place of the image's mean colour.

Ctrl-C stops the fit, saves a checkpoint, and writes what there is so far; pressing it again after a second or more quits at once. A checkpoint holds the rows
of metrics.csv up to it, so that a resumed fit has the whole table, in any folder.";

/// The flags of [`SettingsArgs`] that a checkpoint settles: all but the background, which a resumed fit needs to see a transparent
/// image as before.
const SETTLED: [&str; 11] = [
    "preset",
    "settings",
    "gaussians",
    "iterations",
    "policy",
    "init",
    "loss",
    "blend",
    "antialias",
    "parameterization",
    "seed",
];

/// The flags of `gs fit`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct FitArgs {
    /// The image: PNG, JPEG, BMP, TIFF, WebP, GIF or PNM [default: the paper's circle and square, 128x128]
    pub(crate) image: Option<PathBuf>,
    /// Folder for the results; made if it is not there
    #[arg(short, long, value_name = "DIR", default_value = "gs-out")]
    pub(crate) output: PathBuf,
    #[command(flatten)]
    pub(crate) overwrite: OverwriteArgs,
    /// Print the summary as JSON on standard output, and nothing else there
    #[arg(long)]
    json: bool,
    /// Leave out the two pictures that only explain: ellipses.png and curve.png
    #[arg(long)]
    no_report: bool,
    /// Also print each round of density control, Gaussians whose size reaches a bound, and the effects that are simulated and why
    #[arg(short, long)]
    verbose: bool,
    #[command(flatten)]
    pub(crate) settings: SettingsArgs,
    #[command(flatten)]
    pub(crate) checkpoints: CheckpointArgs,
    /// Go on with a fit from its checkpoint, given the same image; it ends as if it had never stopped
    #[arg(long, value_name = "FILE", conflicts_with_all = SETTLED, conflicts_with = "effects", help_heading = "Checkpoints")]
    pub(crate) resume: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) effects: EffectsArgs,
    #[command(flatten)]
    pub(crate) backend: BackendArgs,
}

/// The files that a fit writes or removes, but for checkpoints.
const FILES: [&str; 10] = [
    "scene.gs2d.safetensors",
    "scene.ply",
    "reconstruction.png",
    "ellipses.png",
    "metrics.csv",
    "metrics.part.csv",
    "curve.png",
    "settings.toml",
    "summary.json",
    // Of a training, whose results do not stay beside those of a fit.
    "evaluation.json",
];

impl FitArgs {
    /// The files that the fit reads.
    pub(crate) fn inputs(&self) -> Inputs {
        [&self.image, &self.settings.settings, &self.resume].into_iter().flatten().collect()
    }

    /// What the fit is going to write.
    pub(crate) fn claim(&self) -> FolderClaim {
        self.overwrite.claim(&self.output, FILES, self.inputs())
    }

    /// How the summary is printed.
    pub(crate) fn format(&self) -> Format {
        if self.json { Format::Json } else { Format::Text }
    }

    /// How much is told while it runs.
    pub(crate) fn detail(&self) -> Detail {
        if self.verbose { Detail::Rounds } else { Detail::Steps }
    }

    /// Which pictures are made.
    pub(crate) fn pictures(&self) -> Pictures {
        if self.no_report { Pictures::Reconstruction } else { Pictures::All }
    }
}

/// Which pictures a fit leaves behind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Pictures {
    /// The reconstruction, the ellipses and the curve.
    All,
    /// The reconstruction only.
    Reconstruction,
}

/// What is fitted and how: a preset or a file of settings, and what is to differ from it.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Settings")]
pub(crate) struct SettingsArgs {
    /// Where to start from [default: standard, or paper without an image]
    #[arg(long, visible_alias = "quality", value_enum, value_name = "PRESET")]
    pub(crate) preset: Option<PresetName>,
    /// Take all settings from a file, such as a settings.toml that a fit has written, or accuracy and backend from one of gs frontier; flags override it
    #[arg(long, value_name = "FILE.toml", conflicts_with = "preset")]
    pub(crate) settings: Option<PathBuf>,
    /// The most Gaussians there may be
    #[arg(short = 'n', long, alias = "max-gaussians", value_name = "N", value_parser = whole::<u32>(1..))]
    pub(crate) gaussians: Option<u32>,
    /// Steps of the optimiser; 0 leaves the first Gaussians as they are
    #[arg(short, long, value_name = "K", value_parser = whole::<u32>(0..))]
    pub(crate) iterations: Option<u32>,
    /// Which Gaussians grow and which go
    #[arg(long, value_enum, value_name = "POLICY")]
    pub(crate) policy: Option<PolicyName>,
    /// Where the first Gaussians are put
    #[arg(long, value_enum, value_name = "INIT")]
    pub(crate) init: Option<InitName>,
    /// What is minimised
    #[arg(long, value_enum, value_name = "LOSS")]
    pub(crate) loss: Option<LossName>,
    /// How the Gaussians at a pixel become its colour
    #[arg(long, value_enum, value_name = "BLEND")]
    pub(crate) blend: Option<BlendName>,
    /// What is done about Gaussians narrower than a pixel [default: none]
    #[arg(long, value_enum, value_name = "ANTIALIAS")]
    pub(crate) antialias: Option<AntialiasName>,
    /// In which coordinates the optimiser moves
    #[arg(long, value_enum, value_name = "NAME", alias = "chart")]
    pub(crate) parameterization: Option<ParameterizationName>,
    /// The colour behind, each part from 0 to 1, such as 1,1,1 for white; with --resume, of transparent pixels only
    #[arg(long, value_name = "R,G,B")]
    pub(crate) background: Option<Color>,
    /// Seed of all random numbers. The same seed gives the same bits for any number of threads, on the same SIMD level or GPU
    #[arg(long, value_name = "S", value_parser = whole::<u32>(0..))]
    pub(crate) seed: Option<u32>,
}

/// Settings that belong together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum PresetName {
    /// The paper's own experiment: 20 Gaussians that grow, front-to-back blending
    Paper,
    /// For a first look: a fraction of the time
    Quick,
    /// For images: the best that a second or so can do
    Standard,
    /// More steps, a little better
    Best,
}

/// A way of placing the first Gaussians.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum InitName {
    /// Anywhere, large
    Random,
    /// Along the border of the image
    Periphery,
    /// On a grid
    Grid,
    /// Where the image has edges
    Gradient,
    /// Where a coarse picture of the image is most wrong
    Error,
}

/// How Gaussians are blended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum BlendName {
    /// Added up: no order, no opacity; fastest
    Sum,
    /// Front to back with opacities, as splat viewers do
    Over,
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Command;

    #[test]
    fn a_checkpoint_settles_every_setting_but_the_background() {
        let command = SettingsArgs::augment_args(Command::new("fit"));
        let mut flags: Vec<&str> = command.get_arguments().map(|flag| flag.get_id().as_str()).collect();
        flags.retain(|&flag| flag != "background");
        assert_eq!(flags, SETTLED);
    }
}
