//! `gs effects`: which effects a scene requires and why, what each costs on this machine, and what
//! leaving it out would change.

mod report;

use std::path::PathBuf;

use clap::Args;
use gs_backend::AnyRasterizer;
use gs_core::{
    Camera, Canvas, Optimizer, Parameterization, Rasterizer as _, RenderSettings, Scene as _, Scene2d, counted,
    effects::RequiresEffects, view::Orbit,
};
use gs_io::{AnyScene, File3d};
use gs_lab::price::effects::{UploadedScene, prices, prove, sampled, training_prices};
use gs_train::train::Views;

use self::report::{Facts, Report, Training};
use crate::{
    backend::BackendArgs,
    cameras,
    dataset::ReadingArgs,
    failure::Failure,
    image_fit::{self, FitSettingsArgs, SettingsFile, Target},
    memory, output,
    render_args::RenderArgs3d,
    scene,
    values::{Axis, Size, canvas, whole},
};

const AFTER_HELP: &str = "\
INPUT is a 3D scene, a 2D scene, or an image, which is fitted first in a few steps.

A 3D scene is seen from the test views of DATASET (from all views if none is held out), or from \
cameras around it. The flags say which effects are wanted; the default is what 3DGS uses. An \
effect is required unless it is certain that no pixel of these views changes by more than 1/512 \
without it. Renderings with and without it verify that; if they contradict it, the effect is \
required.

The table has a row for each effect: its wanted and its required value; the extra time of a \
picture with the wanted value in place of the next cheaper one; the largest difference of a pixel \
and the PSNR between such pictures; and the reason.

With --train, a second table has a row for each correction of a training that DATASET allows: of \
exposure, and of depths by depth maps. Each row compares two trainings of K steps that begin with \
the scene, with the correction and without it: time of a step, and mean PSNR over the test views, \
as it is and with matched colours.";

/// Steps to fit an image: enough that the Gaussians are as many, as large and as crowded as those
/// of a whole fit.
const ITERATIONS: u32 = 100;

/// The flags of `gs effects`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct EffectsCommandArgs {
    /// A scene, or an image to fit first
    input: PathBuf,
    /// Data set of posed images whose views show a 3D scene
    dataset: Option<PathBuf>,
    /// Print JSON on standard output, and nothing else there
    #[arg(long)]
    json: bool,
    /// The most views
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = whole::<u32>(1..=10_000))]
    views: u32,
    /// Measurements of each time
    #[arg(short, long, value_name = "R", default_value_t = 11, value_parser = whole::<u32>(1..=10_000))]
    repetitions: u32,
    /// Also train a 3D scene for K steps on the views of DATASET, with and without the correction of
    /// exposure and of depths
    #[arg(long, value_name = "K", requires = "dataset", value_parser = whole::<u32>(1..=1_000_000))]
    train: Option<u32>,
    /// Size of the pictures [default: that of the image or of the views; otherwise 800x600]
    #[arg(long, value_name = "WxH")]
    size: Option<Size>,
    /// Up direction, around which cameras are placed: x, y, z, -x, -y or -z [default: -y]
    #[arg(long, value_name = "AXIS", allow_hyphen_values = true)]
    up: Option<Axis>,
    #[command(flatten)]
    reading: ReadingArgs,
    #[command(flatten)]
    render: RenderArgs3d,
    #[command(flatten)]
    backend: BackendArgs,
}

/// Decides and verifies which effects are required, measures them, and prints the table.
pub(crate) fn run(args: &EffectsCommandArgs) -> Result<(), Failure> {
    let subject = Subject::load(args)?;
    let backend = match &subject {
        Subject::TwoD { wanted, .. } => args.backend.open_to_render_2d(wanted),
        Subject::ThreeD { .. } | Subject::Image { .. } => args.backend.open(),
    }?;
    let rasterizer = &backend.rasterizer;
    let facts = |seen: String, gaussians: usize, width: u32, height: u32| Facts {
        input: args.input.display().to_string(),
        gaussians,
        seen,
        width,
        height,
        machine: backend.reason.clone(),
    };
    let report = match subject {
        Subject::ThreeD { file, cameras, wanted, seen } => {
            let scene = &file.scene;
            let facts = facts(seen, scene.len(), cameras[0].width, cameras[0].height);
            let report = examine(rasterizer, scene, &cameras, &wanted, args, facts)?;
            Ok(Report { training: training(rasterizer, &file, &wanted, args)?, ..report })
        }
        Subject::TwoD { scene, canvas, wanted } => {
            let facts = facts("its canvas".to_owned(), scene.len(), canvas.width, canvas.height);
            examine(rasterizer, &scene, &[canvas], &wanted, args, facts)
        }
        Subject::Image { target, size } => {
            let flags = FitSettingsArgs { iterations: Some(ITERATIONS), ..FitSettingsArgs::default() };
            let settings = image_fit::settings(&flags, &SettingsFile::None, &target)?;
            let (steps, wanted) = (settings.iterations, settings.render);
            let scene = image_fit::fit_first(rasterizer, &target, settings)?;
            let canvas = canvas(target.image.size(), size)?;
            let seen = format!("its canvas, after {}", counted(steps, "step"));
            let facts = facts(seen, scene.len(), canvas.width, canvas.height);
            examine(rasterizer, &scene, &[canvas], &wanted, args, facts)
        }
    }?;
    if args.json { output::json(&report) } else { output::result(report.text()) }
}

/// What is examined.
enum Subject {
    ThreeD { file: Box<File3d>, cameras: Vec<Camera>, wanted: RenderSettings, seen: String },
    TwoD { scene: Scene2d, canvas: Canvas, wanted: RenderSettings },
    Image { target: Box<Target>, size: Option<Size> },
}

impl Subject {
    fn load(args: &EffectsCommandArgs) -> Result<Self, Failure> {
        let scene_2d = match scene::read_if_any(&args.input)? {
            Some(AnyScene::ThreeD(file)) => return Self::of_3d(args, *file),
            Some(AnyScene::TwoD(file)) => Some(file),
            None => None,
        };
        if args.dataset.is_some() || args.render.is_some() || args.up.is_some() {
            let message = "is not a 3D scene; only those have cameras, an order and a background to choose";
            return Err(Failure::usage(message).at(args.input.display()).hint("use --size alone"));
        }
        if let Some(file) = scene_2d {
            let canvas = canvas((file.width, file.height), args.size)?;
            return Ok(Self::TwoD { scene: file.scene, canvas, wanted: file.settings });
        }
        let target = Target::read_to_fit_first(Some(&args.input))?;
        canvas(target.image.size(), args.size)?;
        Ok(Self::Image { target: Box::new(target), size: args.size })
    }

    fn of_3d(args: &EffectsCommandArgs, file: File3d) -> Result<Self, Failure> {
        args.render.note_guess(&file);
        let scene = &file.scene;
        let most = args.views as usize;
        let Some(path) = &args.dataset else {
            let up = args.up.map_or(cameras::UP, |axis| axis.0);
            let bulk = cameras::bulk_of(scene)?;
            let first = cameras::overview(&bulk, args.size, up)?;
            first.validate().map_err(|error| Failure::usage(error).at("--size"))?;
            let cameras = Orbit { center: bulk.center, axis: up, frames: args.views }.cameras(&first);
            let wanted = args.render.settings(&file, None);
            let seen = format!("{} around it", counted(most, "camera"));
            return Ok(Self::ThreeD { file: Box::new(file), cameras, wanted, seen });
        };
        let dataset = args.reading.read_for(&file, path)?;
        let wanted = args.render.settings(&file, Some(&dataset));
        let views = Views::of_dataset(&dataset);
        let which = if views.test.is_empty() { "view" } else { "test view" };
        let all: Vec<Camera> = views.test_or_train().iter().map(|view| view.camera).collect();
        let sized = |camera: Camera| args.size.map_or(camera, |size| camera.resized(size.width, size.height));
        let cameras: Vec<Camera> = sampled(&all, most).into_iter().map(sized).collect();
        for camera in &cameras {
            camera.validate().map_err(|error| Failure::usage(error).at("--size"))?;
        }
        let seen = format!("{} of {} of {}", cameras.len(), counted(all.len(), which), path.display());
        Ok(Self::ThreeD { file: Box::new(file), cameras, wanted, seen })
    }
}

/// The table of `--train`.
fn training(
    rasterizer: &AnyRasterizer,
    file: &File3d,
    wanted: &RenderSettings,
    args: &EffectsCommandArgs,
) -> Result<Option<Training>, Failure> {
    let Some((path, steps)) = args.dataset.as_ref().zip(args.train) else { return Ok(None) };
    let dataset = args.reading.read_for(file, path)?;
    let prices = training_prices(rasterizer, &file.scene, || Views::of_dataset(&dataset), wanted, steps)?;
    Ok(Some(Training { steps, prices }))
}

fn examine<S: RequiresEffects>(
    rasterizer: &AnyRasterizer,
    scene: &S,
    views: &[S::View],
    wanted: &RenderSettings,
    args: &EffectsCommandArgs,
    facts: Facts,
) -> Result<Report, Failure>
where
    AnyRasterizer: Optimizer<S>,
{
    let size = (facts.width, facts.height);
    memory::check_work("measuring the effects of", &facts.input, size, gs_train::memory::comparing(size, 1))?;
    let splats = rasterizer.upload(scene, Parameterization::ScaleRotation)?;
    let uploaded = UploadedScene { rasterizer, splats: &splats, views };
    let proof = prove(scene, &uploaded, wanted)?;
    let prices = prices(&uploaded, wanted, &proof.required.settings, args.repetitions as usize)?;
    Ok(Report { facts, proof, prices, training: None })
}
