//! The flags of `gs train`.

use std::path::PathBuf;

use clap::{Args, builder::TypedValueParser};
use gs_core::{
    Loss, Participants,
    effects::{Antialias, Order},
};
use gs_density::Policy;
use gs_train::{
    TrainPreset,
    train::{Exposure, RefinePoses, Views},
};

use crate::{
    files::scene,
    flags::{
        dataset::DatasetArgs,
        render_args::DEPTH_ORDERS,
        values::{Color, by_name, bytes, minutes, one_of, whole},
    },
    memory,
    training::arguments::{RunArgs, policy_by_name},
};

const AFTER_HELP: &str = "\
DATASET is a folder that COLMAP, Nerfstudio, Blender, OpenSfM, Metashape, RealityScan or LLFF wrote, \
or its file, such as a transforms.json; gs info shows what is in it. For a folder of photographs \
without poses, or a video, COLMAP finds the poses first, as gs poses does; the data set is kept in \
DIR/dataset.

DIR then holds:
  scene.ply        the Gaussians, for splat viewers; gs convert makes other formats of it
  views/           each held-out view: the image, and its rendering to the right
  refined/         with refined poses, the data set with them: transforms.json and its points, and as \
a text model of COLMAP
  evaluation.json  PSNR, SSIM, MS-SSIM and L1 of each held-out view, and their means
  metrics.csv      count, edits and loss over the steps, now and then with PSNR and L1 over at most \
8 of the held-out views; metrics.part.csv until the end
  curve.svg        count, loss and PSNR over the steps
  settings.toml    all settings, to repeat the training with --settings
  summary.json     what --json prints

Files of earlier runs of gs in DIR are replaced or removed; checkpoints stay. The list of these \
files is DIR/.gs-files.json. If any other file has the name of a result, the training does not \
start; --overwrite replaces it. Other files in views/ stay: new pictures get other names. Two runs \
cannot write into one folder at once. DIR cannot be the folder of the data set or of its images.

If the data set does not say which views are for tests, every 8th is held out. --holdout decides \
in any case. If none is held out, the scene is evaluated with some of the views that it was trained with.

Ctrl-C stops the training, saves a checkpoint, and writes the results so far. Pressing it again \
after a second or more quits at once.";

/// The flags of `gs train`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct TrainArgs {
    /// The data set of posed images, or a folder of photographs
    pub(crate) dataset: PathBuf,
    #[command(flatten)]
    pub(crate) images: DatasetArgs,
    #[command(flatten)]
    pub(crate) settings: TrainSettingsArgs,
    #[command(flatten)]
    pub(crate) run: RunArgs,
    /// The most memory for the images, such as 800M; what exceeds it is kept in a file in the output
    /// folder, which goes when the training ends [default: an eighth of this machine's memory, at most
    /// 2G, or 500M on the CPU where all images take more]
    #[arg(long, value_name = "BYTES", value_parser = bytes, help_heading = "Data sets")]
    pub(crate) image_memory: Option<u64>,
    /// Resume a training from its checkpoint, given the same data set; the result is the same as
    /// without the interruption
    #[arg(long, value_name = "FILE", conflicts_with_all = ["TrainSettingsArgs", "effects"], help_heading = "Checkpoints")]
    pub(crate) resume: Option<PathBuf>,
}

/// Largest default of --image-memory.
const IMAGE_MEMORY: u64 = 2_000_000_000;

/// The same where the CPU trains on images that take more: reading one from the file costs little next
/// to a step there.
const ON_CPU: u64 = 500_000_000;

impl TrainArgs {
    /// Memory for the images of these views, bytes.
    pub(super) fn image_memory(&self, views: &Views, on_cpu: bool) -> u64 {
        let cameras = views.train.iter().chain(&views.test).map(|view| &view.camera);
        let all = 3 * cameras.map(|camera| u64::from(camera.width) * u64::from(camera.height)).sum::<u64>();
        let most = if on_cpu && all > ON_CPU { ON_CPU } else { IMAGE_MEMORY };
        let of_machine = || memory::room().map_or(most, |room| (room / 8).min(most));
        self.image_memory.unwrap_or_else(of_machine)
    }

    /// The files that the flags name for reading, except for the checkpoint to resume.
    pub(super) fn files(&self) -> Vec<PathBuf> {
        let start = self.settings.start.as_ref().map(|start| scene::file_of(start.as_ref()));
        [Some(self.dataset.clone()), self.settings.settings.clone(), start].into_iter().flatten().collect()
    }
}

/// The settings of a training: a preset or a settings file, and changes to it. A checkpoint contains
/// them all.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Settings")]
pub(crate) struct TrainSettingsArgs {
    /// The settings to start from [default: standard]
    #[arg(long, value_parser = by_name::<TrainPreset>(), value_name = "PRESET")]
    pub(crate) preset: Option<TrainPreset>,
    /// Settings file, such as the settings.toml of a training; flags override it
    #[arg(long, value_name = "FILE.toml", conflicts_with_all = ["preset", "iterations"])]
    pub(crate) settings: Option<PathBuf>,
    /// The most Gaussians [default: that of the preset; standard: one for 160 pixels of the views, or
    /// five for each initial point if that is more, but at most twice the former, and fewer if more
    /// harm in a trial before the run]
    #[arg(short = 'n', long, value_name = "N", value_parser = whole::<u32>(1..))]
    pub(crate) gaussians: Option<u32>,
    /// End with exactly the number of Gaussians that --gaussians sets, under any policy
    #[arg(long)]
    pub(crate) exactly: bool,
    /// Finish within M minutes on this machine: a trial of some seconds measures its speed, from
    /// which steps, Gaussians and first resolution are chosen
    #[arg(long, value_name = "M", value_parser = minutes, conflicts_with_all = ["preset", "settings", "iterations", "coarse"])]
    pub(crate) minutes: Option<f64>,
    /// Steps of the optimizer, one view each; the preset's schedules follow [default: 40 a
    /// view, 2000 to 8000, and 4000 instead of fewer if a trial before the run shows that more gain;
    /// quick: 2000, 3dgs and mcmc: 30000]
    #[arg(short, long, value_name = "K", value_parser = whole::<u32>(0..))]
    pub(crate) iterations: Option<u32>,
    /// Density control: which Gaussians grow and which are removed
    #[arg(long, value_parser = policy(), value_name = "POLICY")]
    pub(crate) policy: Option<Policy>,
    /// What to start from: points of the data set (points), these and points found in the images
    /// (points-and-images), these and points of the depth maps (depths), only points found in the images
    /// (images), random points (random), or a scene (a file or an output folder) [default: depths
    /// if there are depth maps; images if there are no points; with preset standard,
    /// points-and-images if there are few points; otherwise points]
    #[arg(long, value_name = "START")]
    pub(crate) start: Option<String>,
    /// Loss to minimise
    #[arg(long, value_parser = by_name::<Loss>(), value_name = "LOSS")]
    pub(crate) loss: Option<Loss>,
    /// Highest degree of spherical harmonics (SH), 0 to 3
    #[arg(long, value_name = "D", value_parser = whole::<u8>(0..=3))]
    pub(crate) sh_degree: Option<u8>,
    /// Order of blending
    #[arg(long, value_parser = one_of(&DEPTH_ORDERS), value_name = "ORDER")]
    pub(crate) order: Option<Order>,
    /// Treatment of Gaussians narrower than a pixel [default: mip for Blender with preset standard or
    /// quick, that of the scene with --start SCENE, otherwise dilate]
    #[arg(long, value_parser = by_name::<Antialias>(), value_name = "ANTIALIAS")]
    pub(crate) antialias: Option<Antialias>,
    /// Background: black, white, or R,G,B, each from 0 to 1 [default: white for Blender, otherwise black]
    #[arg(long, value_name = "COLOUR")]
    pub(crate) background: Option<Color>,
    /// Train with images of 1/F of their size first, then half of that, and so on: 1, 2, 4 or 8
    #[arg(long, value_name = "F", value_parser = whole::<u32>(1..=8))]
    pub(crate) coarse: Option<u32>,
    /// How to treat differences in exposure and white balance between the images
    #[arg(long, value_parser = by_name::<Exposure>(), value_name = "WHICH")]
    pub(crate) exposure: Option<Exposure>,
    /// Whether the cameras move while the scene is trained, for poses that are not exact
    #[arg(long, value_parser = by_name::<RefinePoses>(), value_name = "WHICH")]
    pub(crate) refine_poses: Option<RefinePoses>,
    /// Which Gaussians a step moves
    #[arg(long, value_parser = by_name::<Participants>(), value_name = "WHICH")]
    pub(crate) participants: Option<Participants>,
    /// Seed of all random numbers; the same seed gives the same bits on the same SIMD level or GPU
    #[arg(long, value_name = "S", value_parser = whole::<u32>(0..))]
    pub(crate) seed: Option<u32>,
}

/// A parser of the policies for 3D scenes: not those that use the residual of one image, residual and
/// image-gs.
fn policy() -> impl TypedValueParser<Value = Policy> {
    policy_by_name(|policy| policy.clone().for_3d().validate_3d().is_ok().then_some(""))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_offered_policies_are_those_that_can_train_3d_scenes() {
        let offered: Vec<String> =
            policy().possible_values().unwrap().map(|value| value.get_name().to_owned()).collect();
        for name in Policy::NAMES {
            let settings = TrainPreset::default().settings(None).with_policy(Policy::from_name(name).unwrap());
            assert_eq!(offered.iter().any(|offered| offered == name), settings.validate().is_ok(), "{name}");
        }
    }
}
