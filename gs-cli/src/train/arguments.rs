//! The flags of `gs train`.

use std::{num::NonZeroU32, path::PathBuf};

use clap::{Args, ValueEnum, builder::PossibleValue};
use gs_io::{
    FolderClaim, Inputs,
    dataset::{AlphaMeaning, DatasetSettings},
};

use crate::{
    backend::BackendArgs,
    dataset::ReadingArgs,
    effects::choice::EffectsArgs,
    output::Format,
    output_folder::OverwriteArgs,
    training_arguments::{AntialiasName, CheckpointArgs, Detail, LossName, ParameterizationName, PolicyName},
    values::{Backing, whole},
};

const AFTER_HELP: &str = "\
DATASET is a folder that COLMAP, Nerfstudio or Blender wrote, or a transforms.json; gs info tells what is in it.

DIR then holds:
  scene.ply        the Gaussians, for any viewer of splats; gs convert makes other formats of it
  views/           each held-out view: the photograph, and beside it the rendering
  ellipses.png     the first of these views, with Gaussians drawn over it as ellipses; of many, those that matter most
  evaluation.json  PSNR, SSIM and L1 of each held-out view, and their means
  metrics.csv      count, edits and loss at every 100th part of the steps and at each round of density control; at every
                   20th part and at both ends also PSNR, L1 and what was culled, over the held-out views, and what was
                   clamped; rows come as the training goes on, in metrics.part.csv until it ends well
  curve.png        count, loss and PSNR over the steps
  settings.toml    all settings, to repeat the training with --settings
  summary.json     what --json prints

Files that earlier runs of gs wrote into DIR are replaced, or removed if this training does not write them; checkpoints stay. The list of these
files is DIR/.gs-files.json. If any other file has the name of a result, the training does not start; --overwrite replaces it. Files in
views/ that no run wrote stay: new pictures get other names. Two runs cannot write into one folder at once. DIR cannot be the data set's own folder, nor hold
its photographs.

A data set that does not say which views are for tests has every 8th held out (--holdout). Without any, a few of the views that it
trains with tell how good the scene is.

Ctrl-C stops the training, saves a checkpoint, and writes what there is so far; pressing it again after a second
or more quits at once.";

/// The flags that a checkpoint settles.
const SETTLED: [&str; 17] = [
    "preset",
    "settings",
    "gaussians",
    "iterations",
    "policy",
    "start",
    "loss",
    "parameterization",
    "sh_degree",
    "order",
    "antialias",
    "background",
    "coarse",
    "participants",
    "opacity_weight",
    "scale_weight",
    "seed",
];

/// The flags of `gs train`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct TrainArgs {
    /// The posed photographs
    pub(crate) dataset: PathBuf,
    /// Folder for the results; made if it is not there
    #[arg(short, long, value_name = "DIR", default_value = "gs-out")]
    pub(crate) output: PathBuf,
    #[command(flatten)]
    pub(crate) overwrite: OverwriteArgs,
    /// Print the summary as JSON on standard output, and nothing else there
    #[arg(long)]
    json: bool,
    /// Leave out the pictures: views/, ellipses.png and curve.png
    #[arg(long)]
    pub(crate) no_report: bool,
    /// Also print each round of density control, Gaussians whose size reaches a bound, and the effects that are simulated and why
    #[arg(short, long)]
    verbose: bool,
    #[command(flatten)]
    pub(crate) photographs: DatasetArgs,
    #[command(flatten)]
    pub(crate) settings: TrainSettingsArgs,
    #[command(flatten)]
    pub(crate) checkpoints: CheckpointArgs,
    /// Go on with a training from its checkpoint, given the same data set; it ends as if it had never stopped
    #[arg(long, value_name = "FILE", conflicts_with_all = SETTLED, conflicts_with = "effects", help_heading = "Checkpoints")]
    pub(crate) resume: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) effects: EffectsArgs,
    #[command(flatten)]
    pub(crate) backend: BackendArgs,
}

/// The files that a training writes or removes, but for checkpoints and pictures of views.
const FILES: [&str; 10] = [
    "scene.ply",
    // Of a fit, whose results do not stay beside those of a training.
    "scene.gs2d.safetensors",
    "reconstruction.png",
    "ellipses.png",
    "evaluation.json",
    "metrics.csv",
    "metrics.part.csv",
    "curve.png",
    "settings.toml",
    "summary.json",
];

impl TrainArgs {
    /// The files that the flags name for reading, but for the checkpoint to go on from.
    pub(crate) fn files(&self) -> impl Iterator<Item = PathBuf> {
        let start = self.settings.start.as_ref().map(PathBuf::from);
        [Some(self.dataset.clone()), self.settings.settings.clone(), start].into_iter().flatten()
    }

    /// What the training is going to write, given the other files that it reads.
    pub(crate) fn claim(&self, others: impl IntoIterator<Item = PathBuf>) -> FolderClaim {
        let inputs: Inputs = self.files().chain(self.resume.clone()).chain(others).collect();
        self.overwrite.claim(&self.output, FILES, inputs)
    }

    /// How the summary is printed.
    pub(crate) fn format(&self) -> Format {
        if self.json { Format::Json } else { Format::Text }
    }

    /// How much is told while it runs.
    pub(crate) fn detail(&self) -> Detail {
        if self.verbose { Detail::Rounds } else { Detail::Steps }
    }
}

/// How a data set is read.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Photographs")]
pub(crate) struct DatasetArgs {
    /// Hold out every N-th view by name for tests, if the data set does not say which; 0 holds out none
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = whole::<u32>(0..))]
    pub(crate) holdout: u32,
    /// The folder of the data set to take photographs from, such as images_4 [default: the first that there is]
    #[arg(long, value_name = "FOLDER")]
    pub(crate) images: Option<String>,
    /// What the photographs' alpha channel means
    #[arg(long, value_enum, default_value_t)]
    pub(crate) alpha: AlphaName,
    #[command(flatten)]
    pub(crate) reading: ReadingArgs,
}

impl DatasetArgs {
    /// As the library has it.
    pub(crate) fn settings(&self) -> DatasetSettings {
        DatasetSettings {
            image_folder: self.images.clone(),
            test_every: NonZeroU32::new(self.holdout),
            alpha: match self.alpha {
                AlphaName::Opacity => AlphaMeaning::Opacity,
                AlphaName::Mask => AlphaMeaning::Mask,
            },
            ..self.reading.settings()
        }
    }
}

/// What an alpha channel means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(crate) enum AlphaName {
    /// How opaque the object is: the scene shall be as transparent
    #[default]
    Opacity,
    /// Which pixels count
    Mask,
}

/// What is trained and how: a preset or a file of settings, and what is to differ from it.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Settings")]
pub(crate) struct TrainSettingsArgs {
    /// Where to start from [default: 3dgs]
    #[arg(long, value_enum, value_name = "PRESET")]
    pub(crate) preset: Option<TrainPresetName>,
    /// Take all settings from a file, such as a settings.toml that a training has written; flags override it
    #[arg(long, value_name = "FILE.toml", conflicts_with_all = ["preset", "iterations"])]
    pub(crate) settings: Option<PathBuf>,
    /// The most Gaussians there may be
    #[arg(short = 'n', long, alias = "max-gaussians", value_name = "N", value_parser = whole::<u32>(1..))]
    pub(crate) gaussians: Option<u32>,
    /// Steps of the optimiser, one view each; the preset's schedules follow [default: 30000, short: 6000, quick: 2000]
    #[arg(short, long, value_name = "K", value_parser = whole::<u32>(0..))]
    pub(crate) iterations: Option<u32>,
    /// Which Gaussians grow and which go
    #[arg(long, value_enum, value_name = "POLICY")]
    pub(crate) policy: Option<TrainPolicyName>,
    /// Where the first Gaussians come from: points of the data set, random, or a scene file [default: points if there are any]
    #[arg(long, value_name = "points|random|SCENE")]
    pub(crate) start: Option<String>,
    /// What is minimised
    #[arg(long, value_enum, value_name = "LOSS")]
    pub(crate) loss: Option<LossName>,
    /// In which coordinates the optimiser moves
    #[arg(long, value_enum, value_name = "NAME", alias = "chart")]
    pub(crate) parameterization: Option<ParameterizationName>,
    /// Highest degree of the spherical harmonics, 0 to 3
    #[arg(long, value_name = "D", value_parser = whole::<u8>(0..=3))]
    pub(crate) sh_degree: Option<u8>,
    /// In which order Gaussians are blended
    #[arg(long, value_enum, value_name = "ORDER")]
    pub(crate) order: Option<OrderName>,
    /// What is done about Gaussians narrower than a pixel
    #[arg(long, value_enum, value_name = "ANTIALIAS")]
    pub(crate) antialias: Option<AntialiasName>,
    /// What is behind: black, white, random (another colour in each step), or R,G,B [default: white for Blender, else black]
    #[arg(long, value_name = "COLOUR")]
    pub(crate) background: Option<Backing>,
    /// Train with pictures of 1/F of their size first, then half of that, and so on: 1, 2, 4 or 8
    #[arg(long, value_name = "F", value_parser = whole::<u32>(1..=8))]
    pub(crate) coarse: Option<u32>,
    /// Which Gaussians a step moves
    #[arg(long, value_enum, value_name = "WHICH")]
    pub(crate) participants: Option<ParticipantsName>,
    /// Weight of the mean opacity in the loss, as 3DGS-MCMC has it
    #[arg(long, value_name = "W")]
    pub(crate) opacity_weight: Option<f32>,
    /// Weight of the mean scale in the loss, as 3DGS-MCMC has it
    #[arg(long, value_name = "W")]
    pub(crate) scale_weight: Option<f32>,
    /// Seed of all random numbers. The same seed gives the same bits for any number of threads, on the same SIMD level or GPU
    #[arg(long, value_name = "S", value_parser = whole::<u32>(0..))]
    pub(crate) seed: Option<u32>,
}

/// Settings that belong together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum TrainPresetName {
    /// 3D Gaussian Splatting as it was published
    #[value(name = "3dgs")]
    ThreeDgs,
    /// 3DGS-MCMC: a fixed number of Gaussians, moved to where they are needed
    Mcmc,
    /// For runs of minutes: as 3dgs, with longer steps, and all schedules within the run
    Short,
    /// For a first look
    Quick,
}

/// A way of controlling density that 3D scenes have, too.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct TrainPolicyName(PolicyName);

impl ValueEnum for TrainPolicyName {
    fn value_variants<'a>() -> &'a [Self] {
        // Without those that look at the residual of an image: residual and image-gs.
        const ALL: [TrainPolicyName; 13] = [
            TrainPolicyName(PolicyName::Absolute),
            TrainPolicyName(PolicyName::AbsGs),
            TrainPolicyName(PolicyName::AbsoluteError),
            TrainPolicyName(PolicyName::Percentile),
            TrainPolicyName(PolicyName::PercentileAbsGs),
            TrainPolicyName(PolicyName::PercentileError),
            TrainPolicyName(PolicyName::Hybrid),
            TrainPolicyName(PolicyName::HybridAbsGs),
            TrainPolicyName(PolicyName::HybridError),
            TrainPolicyName(PolicyName::LongAxis),
            TrainPolicyName(PolicyName::Paper),
            TrainPolicyName(PolicyName::Mcmc),
            TrainPolicyName(PolicyName::None),
        ];
        &ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        self.0.to_possible_value()
    }
}

/// An order of blending.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum OrderName {
    /// By the depth of the means (3DGS)
    #[value(alias = "tile-depth")]
    Global,
    /// By the depth at each pixel: no popping, slower
    #[value(alias = "pixel-depth")]
    PerPixel,
}

/// Who takes part in a step of Adam.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum ParticipantsName {
    /// All (3DGS)
    All,
    /// Those that the step's view shows
    Visible,
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Command;
    use gs_density::Policy;
    use gs_train::TrainPreset;

    #[test]
    fn the_policies_that_are_offered_are_those_that_can_train_in_space() {
        let offered: Vec<String> = TrainPolicyName::value_variants()
            .iter()
            .map(|name| name.to_possible_value().unwrap().get_name().to_owned())
            .collect();
        for name in Policy::NAMES {
            let settings = TrainPreset::default().settings(None).with_policy(Policy::from_name(name).unwrap());
            assert_eq!(offered.iter().any(|offered| offered == name), settings.validate().is_ok(), "{name}");
        }
    }

    #[test]
    fn a_checkpoint_settles_every_setting() {
        let command = TrainSettingsArgs::augment_args(Command::new("train"));
        let flags: Vec<&str> = command.get_arguments().map(|flag| flag.get_id().as_str()).collect();
        assert_eq!(flags, SETTLED);
    }
}
