//! `gs render`: a scene as a picture, or as many pictures of a moving camera.

mod panorama;
mod plan;
mod scene2d;
mod scene3d;

use std::path::PathBuf;

use clap::Args;
use glam::Vec3;

use gs_core::{RenderSettings, Scene as _, counted};
use gs_io::{AnyScene, Extent, GsiFile, is_gsi, read_gsi};
use gs_lab::study::overrides;
use toml::Table;

use crate::{
    failure::Failure,
    files::{lod::Lod, output_folder::OverwriteArgs, scene},
    flags::{
        backend::BackendArgs,
        dataset::ReadingArgs,
        effects_args::EffectsArgs,
        render_args::RenderArgs3d,
        values::{Behind, Region, Size, ViewName, axis, positive, whole},
    },
    terminal::output::{self, printable},
};

const AFTER_HELP: &str = "\
A 2D scene becomes one PNG, of any size or part, with the alpha and the ICC profile of a .gsi file. \
A 3D scene is rendered from a view of a data set \
(--camera images/:DSC_0042.JPG), an orbit, or a path; by default, from slightly above. For an orbit \
or a path, OUTPUT is an animated PNG if it ends in .apng, a PNG if it ends in .png and there is a single \
frame, and otherwise a folder of frames. Frames of an earlier, longer film in that folder are \
removed.

With --background none, the pictures of a 3D scene are RGBA PNGs: alpha is 1 less the \
transmittance, and colours are not multiplied by it, as PNG demands.

With --camera, --orbit moves that camera around the point that the cameras of the data set look at.

A path is a JSON file such as
  { \"width\": 800, \"height\": 600, \"fov\": 60,
    \"up\": [0, -1, 0], \"frames\": 90, \"ends\": \"open\",
    \"keys\": [
      { \"position\": [0, 0, -4], \"target\": [0, 0, 0] },
      { \"position\": [4, 0, 0], \"target\": [0, 0, 0] }] }
in the scene's own axes and unit; fov is horizontal, in degrees.";

/// The help of `--background` of `gs render`.
const BACKGROUND: &str = "Background colour: black, white, R,G,B, or none for PNGs with alpha [default: black; white for \
                          a Blender data set]";

/// The flags of `gs render`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP, mut_arg("background", |arg| arg.help(BACKGROUND).value_parser(Behind::any)))]
pub(crate) struct RenderArgs {
    /// The scene: a scene file, a checkpoint, or the output folder of gs fit or gs train
    scene: PathBuf,
    /// The PNG to write, or the GeoTIFF (.tif) of a plan; for an orbit or a path, a folder of frames or an animated PNG
    /// (.apng)
    #[arg(short, long, value_name = "OUTPUT")]
    output: PathBuf,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Write depths along the optical axis instead of colours: grey PNGs of 16 bits in steps of this part of the
    /// scene's unit; 0 where less than half of a pixel is covered, and beyond 65,535 steps
    #[arg(long, value_name = "STEP", num_args = 0..=1, require_equals = true, default_missing_value = "0.001",
          value_parser = above_0, conflicts_with_all = ["panorama", "ortho", "region", "background"])]
    depth: Option<f32>,
    /// Also print the effects that are simulated, and why
    #[arg(short, long)]
    verbose: bool,
    /// Render a .gsi file that is truncated as far as it goes
    #[arg(long)]
    partial: bool,
    /// Size of the picture; other proportions stretch it [default: that of the image, the region or
    /// the view; otherwise 800x600]
    #[arg(long, value_name = "WxH")]
    size: Option<Size>,
    /// Render only this part of a 2D scene, in pixels of the original image; it may reach beyond
    /// the border
    #[arg(long, value_name = "X,Y,W,H", allow_hyphen_values = true, conflicts_with_all = ["camera", "orbit", "path"])]
    region: Option<Region>,
    /// Draw at most N Gaussians of a scene with levels of detail: each part of it in the coarsest level whose
    /// error stays below a pixel, or the smallest error that N allows; one choice for all frames
    #[arg(long, value_name = "N", value_parser = whole::<u32>(1..))]
    max_gaussians: Option<u32>,
    /// Cut-offs instead of the scene's, such as alpha-cut=0.001,alpha-max=0.999,transmittance-min=0;
    /// gs frontier measures them
    #[arg(long, value_name = "KEY=VALUE,...", value_parser = cutoffs, help_heading = "Rendering")]
    accuracy: Option<Table>,
    #[command(flatten)]
    cameras: CameraArgs,
    #[command(flatten)]
    effects: EffectsArgs,
    #[command(flatten)]
    render: RenderArgs3d,
    #[command(flatten)]
    backend: BackendArgs,
}

impl RenderArgs {
    /// The files that the flags name for reading.
    fn inputs(&self) -> impl Iterator<Item = PathBuf> {
        let scene = scene::file_of(&self.scene);
        [Some(scene), self.cameras.path.clone()].into_iter().flatten()
    }

    /// A scene's settings with the cut-offs that the flags ask for.
    fn with_accuracy(&self, settings: RenderSettings) -> Result<RenderSettings, Failure> {
        let Some(accuracy) = &self.accuracy else { return Ok(settings) };
        let over = Table::from_iter([("accuracy".to_owned(), accuracy.clone().into())]);
        let settings = overrides::applied(&settings, &over);
        let settings = settings.map_err(|problem| Failure::usage(problem).at("--accuracy"))?;
        settings.validate().map_err(|error| Failure::usage(error).at("--accuracy"))?;
        Ok(settings)
    }
}

/// Numbers and names by key.
fn cutoffs(text: &str) -> Result<Table, &'static str> {
    let pair = |pair: &str| {
        let (key, value) = pair.split_once('=')?;
        let number = value.trim().parse::<f64>().map(toml::Value::Float);
        Some((key.trim().to_owned(), number.unwrap_or_else(|_| value.trim().to_owned().into())))
    };
    text.split(',').map(pair).collect::<Option<_>>().ok_or("write KEY=VALUE, and commas between several")
}

/// The cameras of a 3D scene.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Camera")]
struct CameraArgs {
    /// Camera of a view of a data set
    #[arg(long, value_name = "DATASET:VIEW", conflicts_with = "path")]
    camera: Option<ViewName>,
    /// N cameras on a circle around the scene
    #[arg(long, value_name = "N", conflicts_with = "path", value_parser = whole::<u32>(1..=100_000))]
    orbit: Option<u32>,
    /// Cameras along the path in this file
    #[arg(long, value_name = "FILE.json", conflicts_with = "size")]
    path: Option<PathBuf>,
    /// A plan: the scene from straight above without perspective, at this many pixels a unit of the scene; if the scene
    /// is in map coordinates, with its place on the map
    #[arg(long, value_name = "PX", value_parser = positive,
          conflicts_with_all = ["camera", "orbit", "path", "panorama"])]
    ortho: Option<f64>,
    /// EPSG code of the data set's projected coordinate system, for the GeoTIFF of a plan; 32632 is UTM zone 32 north
    #[arg(long, value_name = "CODE", value_parser = epsg, requires = "ortho")]
    epsg: Option<u16>,
    /// All directions around the camera as one equirectangular picture [size: 2000x1000, or that of a path]
    #[arg(long)]
    panorama: bool,
    /// Up direction and axis of an orbit: x, y, z, -x, -y or -z [default: that of the data set,
    /// z for a plan with a place on a map, otherwise -y]
    #[arg(long, value_name = "AXIS", value_parser = axis, allow_hyphen_values = true)]
    up: Option<Vec3>,
    /// Frames per second of an animated PNG
    #[arg(long, value_name = "F", default_value_t = 24, value_parser = whole::<u16>(1..=240))]
    fps: u16,
    #[command(flatten)]
    reading: ReadingArgs,
}

/// Parses a number above 0.
fn above_0(text: &str) -> Result<f32, String> {
    let value = text.parse().ok().filter(|value: &f32| value.is_finite() && *value > 0.0);
    value.ok_or_else(|| "must be a number above 0".to_owned())
}

/// Parses the EPSG code of a projected coordinate system, as GeoTIFF stores it.
fn epsg(text: &str) -> Result<u16, String> {
    match whole::<u16>(1024..=32766)(text)? {
        4258 | 4269 | 4326 | 4937 | 4978 | 4979 => {
            Err("must be a projected system, not one in degrees or ECEF".to_owned())
        }
        code => Ok(code),
    }
}

/// Endings of formats that are not written, except TIFF for plans. A PNG with such a name would be mistaken for one.
const OTHER_PICTURES: [&str; 10] = ["jpg", "jpeg", "gif", "webp", "avif", "bmp", "tif", "tiff", "exr", "mp4"];

/// Renders a scene.
pub(crate) fn run(args: &RenderArgs) -> Result<(), Failure> {
    let ending = args.output.extension().map(|ending| ending.to_string_lossy().to_lowercase());
    let is_tiff = plan::is_tiff(&args.output);
    let is_geotiff = is_tiff && args.cameras.ortho.is_some();
    if !is_geotiff && ending.is_some_and(|ending| OTHER_PICTURES.contains(&ending.as_str())) {
        let failure = Failure::usage("a picture is written as PNG").at(args.output.display());
        return Err(failure.hint("let its name end in .png, in .apng for an animation, or in .tif with --ortho"));
    }
    if args.cameras.epsg.is_some() && !is_tiff {
        let failure = Failure::usage("only a TIFF names its coordinate system").at("--epsg");
        return Err(failure.hint("let the name of the output end in .tif"));
    }
    if let Some(budget) = args.max_gaussians {
        let lod = Lod::open(&args.scene, budget)?;
        return scene3d::run(args, &lod.coarsest()?, Some(&lod));
    }
    let picture = if args.partial || is_gsi(&args.scene) {
        read_compressed(args)?
    } else {
        match scene::read_any(&args.scene)? {
            AnyScene::ThreeD(file) => return scene3d::run(args, &file, None),
            AnyScene::TwoD(file) => (*file).into(),
        }
    };
    let CameraArgs { camera, orbit, path, up, ortho, panorama, .. } = &args.cameras;
    let has_camera = camera.is_some() || orbit.is_some() || path.is_some() || ortho.is_some() || *panorama;
    if has_camera || up.is_some() || args.depth.is_some() || args.render.is_some() {
        let message = "is a 2D scene, which has no camera, order or background to choose";
        return Err(Failure::usage(message).at(args.scene.display()).hint("use --size and --region alone"));
    }
    scene2d::run(args, picture)
}

/// Reads a `.gsi` file, and says how much of a truncated one is there.
fn read_compressed(args: &RenderArgs) -> Result<GsiFile, Failure> {
    let path = &args.scene;
    if !args.partial {
        return read_gsi(path, Extent::Whole).map_err(Failure::of_scene);
    }
    let file = read_gsi(path, Extent::Prefix)?;
    let (whole, all) = file.layers;
    if whole < all {
        let gaussians = file.colors.scene.len() + file.alpha.as_ref().map_or(0, |alpha| alpha.scene.len());
        let (gaussians, layers) = (counted(gaussians, "Gaussian"), counted(all, "layer"));
        output::note(format_args!(
            "note: {} is truncated: it has {gaussians}, and {whole} of {layers} whole",
            printable(&path.display().to_string())
        ));
    }
    Ok(file)
}
