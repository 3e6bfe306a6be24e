//! The flags of `gs fit`.

use std::path::{Path, PathBuf};

use clap::Args;

use crate::{
    failure::Failure,
    image_fit::FitSettingsArgs,
    training::{arguments::RunArgs, job::Job},
};

const AFTER_HELP: &str = "\
DIR then holds:
  reconstruction.png      the Gaussians rendered at the image's size
  scene.gs2d.safetensors  the Gaussians, for gs view, gs render, gs convert and gs info
  ellipses.png            the most important Gaussians as ellipses over the reconstruction
  metrics.csv             count, edits and loss over the steps, now and then with L1 and PSNR; \
metrics.part.csv until the end
  curve.svg               count, loss and PSNR over the steps
  settings.toml           all settings, to repeat the fit with --settings
  summary.json            what --json prints

Files of earlier runs of gs in DIR are replaced or removed; checkpoints stay. The list of these \
files is DIR/.gs-files.json. If any other file has the name of a result, the fit does not start; \
--overwrite replaces it. Two runs cannot write into one folder at once.

Transparent pixels are fitted as they look on white or on --background. With --blend over, that \
colour is also the background of the scene, in place of the image's mean colour.

Ctrl-C stops the fit, saves a checkpoint, and writes the results so far. Pressing it again after a \
second or more quits at once. A resumed fit may write into any folder: its checkpoint holds the \
rows of metrics.csv so far.

With several images, or a folder, photo.jpg is fitted into DIR/photo/. Of a folder, its images are \
taken, without folders in it. Small images are fitted side by side, one for each thread. An image that \
fails does not keep the others from being fitted; a table comes at the end, then the failures, and \
the exit status is 1. --json then prints an array of summaries; an image that failed has \"error\".";

/// The flags of [`FitSettingsArgs`] that a checkpoint contains. A resumed fit needs the background
/// for transparent pixels.
const IN_CHECKPOINT: [&str; 13] = [
    "preset",
    "settings",
    "gaussians",
    "exactly",
    "iterations",
    "policy",
    "init",
    "loss",
    "tune",
    "blend",
    "antialias",
    "parameterization",
    "seed",
];

/// The flags of `gs fit`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct FitArgs {
    /// The image: PNG, JPEG, BMP, TIFF, WebP, GIF or PNM; several, and folders of images, are fitted
    /// each into a folder of its own in DIR [default: the paper's circle and square, 128x128]
    #[arg(value_name = "IMAGE")]
    pub(crate) images: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) settings: FitSettingsArgs,
    #[command(flatten)]
    pub(crate) run: RunArgs,
    /// Resume a fit from its checkpoint, given the same image; the result is the same as without
    /// the interruption
    #[arg(long, value_name = "FILE", conflicts_with_all = IN_CHECKPOINT, conflicts_with = "effects", help_heading = "Checkpoints")]
    pub(crate) resume: Option<PathBuf>,
}

impl FitArgs {
    /// The fit of this image, or of the paper's, into this folder.
    pub(super) fn job(&self, image: Option<&Path>, folder: &Path) -> Result<Job, Failure> {
        let inputs: Vec<PathBuf> =
            [image, self.settings.settings.as_deref()].into_iter().flatten().map(Path::to_owned).collect();
        self.run.job(folder, &inputs, self.resume.as_deref())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Command;

    #[test]
    fn a_checkpoint_contains_every_setting_but_the_background() {
        let command = FitSettingsArgs::augment_args(Command::new("fit"));
        let mut flags: Vec<&str> = command.get_arguments().map(|flag| flag.get_id().as_str()).collect();
        flags.retain(|&flag| flag != "background");
        assert_eq!(flags, IN_CHECKPOINT);
    }
}
