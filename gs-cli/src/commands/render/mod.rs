//! `gs render`: a scene as a picture or, of a 3D scene, as many pictures of a moving camera.

mod scene2d;
mod scene3d;

use std::path::PathBuf;

use clap::Args;

use crate::{
    backend::BackendArgs,
    dataset::ReadingArgs,
    effects::choice::EffectsArgs,
    failure::Failure,
    opened::{self, Scene},
    output_folder::OverwriteArgs,
    shown::ShownArgs,
    values::{Axis, Region, Size, ViewName, whole},
};

const AFTER_HELP: &str = "\
A scene of an image becomes one PNG, of any size or part. A 3D scene (PLY, .splat, SPZ, glTF) needs a camera: that of a view of a \
data set (--camera photographs:DSC_0042.JPG), an orbit, or a path; without any, a flat scene is shown from its front, filling the \
picture, and any other scene from slightly above. For an orbit or a path, OUTPUT is an animated PNG if it ends in .apng, a PNG if it ends \
in .png and there is a single frame, and otherwise a folder of frames. Frames that an earlier, longer film left in that folder are removed.

With --camera, --orbit takes that camera around what the cameras of the data set look at.

A path is a JSON file such as
  { \"width\": 800, \"height\": 600, \"fov\": 60, \"up\": [0, -1, 0], \"frames\": 90, \"ends\": \"open\",
    \"keys\": [{ \"position\": [0, 0, -4], \"target\": [0, 0, 0] }, { \"position\": [4, 0, 0], \"target\": [0, 0, 0] }] }
in the scene's own axes and unit, fov across in degrees.";

/// The flags of `gs render`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct RenderArgs {
    /// The scene: a file, a checkpoint, or the output folder of gs fit or gs train
    scene: PathBuf,
    /// The PNG to write; of an orbit or a path a folder of frames, or an animated PNG (.apng)
    #[arg(short, long, value_name = "OUTPUT")]
    output: PathBuf,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Also print the effects that are simulated, and why
    #[arg(short, long)]
    verbose: bool,
    /// Size of the picture; other proportions stretch it [default: that of the image, the region or the view; otherwise 800x600 in 3D, or the picture's size for a flat scene]
    #[arg(long, value_name = "WxH")]
    size: Option<Size>,
    /// Show only this part of an image's scene, in pixels of the original image; it may reach beyond the border
    #[arg(long, value_name = "X,Y,W,H", allow_hyphen_values = true, conflicts_with_all = ["camera", "orbit", "path"])]
    region: Option<Region>,
    #[command(flatten)]
    cameras: CameraArgs,
    /// Take accuracy, effects and backend from a file that gs frontier has written; flags override it
    #[arg(long, value_name = "FILE.toml")]
    settings: Option<PathBuf>,
    #[command(flatten)]
    effects: EffectsArgs,
    #[command(flatten)]
    shown: ShownArgs,
    #[command(flatten)]
    backend: BackendArgs,
}

impl RenderArgs {
    /// The files that the flags name for reading.
    fn inputs(&self) -> impl Iterator<Item = PathBuf> {
        let scene = opened::file_of(&self.scene);
        [Some(scene), self.settings.clone(), self.cameras.path.clone()].into_iter().flatten()
    }

    /// Which effects are simulated: with a file of settings, those that it has, unless the flag says otherwise.
    fn effects(&self) -> EffectsArgs {
        if self.settings.is_some() { self.effects.or_as_chosen() } else { self.effects.clone() }
    }
}

/// Where a 3D scene is seen from.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Camera")]
struct CameraArgs {
    /// From where a photograph of a data set was taken
    #[arg(long, value_name = "DATASET:VIEW", conflicts_with = "path")]
    camera: Option<ViewName>,
    /// From N places on a circle around the scene
    #[arg(long, value_name = "N", conflicts_with = "path", value_parser = whole::<u32>(1..=100_000))]
    orbit: Option<u32>,
    /// Along the path in this file
    #[arg(long, value_name = "FILE.json", conflicts_with = "size")]
    path: Option<PathBuf>,
    /// The axis that an orbit goes around and that is up in the picture: x, y, z, or -x, -y, -z [default: -y, or that of the data set]
    #[arg(long, value_name = "AXIS", allow_hyphen_values = true)]
    up: Option<Axis>,
    /// Frames per second of an animated PNG
    #[arg(long, value_name = "F", default_value_t = 24, value_parser = whole::<u16>(1..=240))]
    fps: u16,
    #[command(flatten)]
    reading: ReadingArgs,
}

/// Endings of pictures and films that are not written: a PNG under such a name would be taken for one.
const OTHER_PICTURES: [&str; 10] = ["jpg", "jpeg", "gif", "webp", "avif", "bmp", "tif", "tiff", "exr", "mp4"];

/// Renders a scene.
///
/// # Errors
/// Where the scene cannot be read, what is asked for is not possible, or the pictures cannot be written.
pub(crate) fn run(args: &RenderArgs) -> Result<(), Failure> {
    let ending = args.output.extension().map(|ending| ending.to_string_lossy().to_lowercase());
    if ending.is_some_and(|ending| OTHER_PICTURES.contains(&ending.as_str())) {
        let failure = Failure::usage("a picture is written as PNG").at(args.output.display());
        return Err(failure.mend("let its name end in .png, of an animation in .apng"));
    }
    let file = match opened::scene(&args.scene)? {
        Scene::ThreeD(scene_3d) => return scene3d::run(args, &scene_3d),
        Scene::TwoD(file) => file,
    };
    let CameraArgs { camera, orbit, path, up, .. } = &args.cameras;
    if camera.is_some() || orbit.is_some() || path.is_some() || up.is_some() || args.shown.is_some() {
        let message = "is the scene of an image, which has no camera, order or background to choose";
        return Err(Failure::usage(message).at(args.scene.display()).mend("use --size and --region alone"));
    }
    scene2d::run(args, file)
}
