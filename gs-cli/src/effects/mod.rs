//! `gs effects`: which effects a scene calls for and why, what each costs on this machine, and what leaving it out would change.

pub(crate) mod choice;
mod report;

use pollster::FutureExt as _;
use std::path::PathBuf;

use clap::Args;
use gs_core::{
    Camera, Canvas, Optimizer, Parameterization, RenderSettings, Scene, Scene2d, Scene3d, counted,
    effects::RequiresEffects, view::Orbit,
};
use gs_lab::effects::{UploadedScene, prices, prove, sampled};
use gs_train::{
    Trainer, is_scene,
    train::{PosedView, Views},
};

use crate::{
    backend::{Backend, BackendArgs, Task},
    cameras,
    dataset::ReadingArgs,
    effects::report::{Facts, Report},
    failure::Failure,
    fit::{
        arguments::SettingsArgs,
        settings::{self, Given},
        target::Target,
    },
    opened::{self, Opened3d},
    output,
    shown::ShownArgs,
    values::{Axis, Size, canvas, whole},
};

const AFTER_HELP: &str = "\
INPUT is taken as it comes: a 3D scene, the scene of an image, or an image, which is fitted first in a few steps.

A 3D scene is looked at through the test views of DATASET (the others, where none are held out), or from places around it. What is \
wanted is what the flags say: by default what 3DGS trains and shows scenes with. An effect is called for unless it is certain that no pixel of \
these views changes by more than 1/512 without it; the views are then rendered both ways to prove it, and where they contradict, the effect stays.

The table has a row for each effect: its wanted value and the one that is called for; what a picture takes longer with the wanted value than with \
the next cheaper one, and the largest difference of a pixel and the PSNR between pictures with the one and the other; and why.";

/// Steps in which an image is fitted: enough that the Gaussians are as many, as large and as crowded as those of a whole fit.
const ITERATIONS: u32 = 100;

/// The flags of `gs effects`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct EffectsCommandArgs {
    /// A scene, or an image to which Gaussians are fitted first
    input: PathBuf,
    /// Posed photographs, from where a 3D scene is seen
    dataset: Option<PathBuf>,
    /// Print JSON on standard output, and nothing else there
    #[arg(long)]
    json: bool,
    /// The most views that are looked at
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = whole::<u32>(1..=10_000))]
    views: u32,
    /// How often each time is measured
    #[arg(short, long, value_name = "R", default_value_t = 11, value_parser = whole::<u32>(1..=10_000))]
    repetitions: u32,
    /// Size of the pictures [default: that of the image or of the photographs; in 3D else 800x600]
    #[arg(long, value_name = "WxH")]
    size: Option<Size>,
    /// The axis that places around a 3D scene go around: x, y, z, or -x, -y, -z [default: -y]
    #[arg(long, value_name = "AXIS", allow_hyphen_values = true)]
    up: Option<Axis>,
    #[command(flatten)]
    reading: ReadingArgs,
    #[command(flatten)]
    shown: ShownArgs,
    #[command(flatten)]
    backend: BackendArgs,
}

/// Decides, proves, measures and prints the table.
///
/// # Errors
/// Where input, data set or flags are not possible, or the backend fails.
pub(crate) fn run(args: &EffectsCommandArgs) -> Result<(), Failure> {
    let subject = Subject::load(args)?;
    let backend = match &subject {
        Subject::TwoD { wanted, .. } => Backend::start_for_image(&args.backend, wanted),
        Subject::ThreeD { .. } | Subject::Image { .. } => Backend::start(&args.backend),
    }?;
    let report = backend.run(Examine { subject, args, backend: &backend })?;
    if args.json { output::json(&report) } else { output::result(report.text()) }
}

/// What is examined.
enum Subject {
    ThreeD { scene: Scene3d, cameras: Vec<Camera>, wanted: RenderSettings, seen: String },
    TwoD { scene: Scene2d, canvas: Canvas, wanted: RenderSettings },
    Image { target: Box<Target>, size: Option<Size> },
}

impl Subject {
    fn load(args: &EffectsCommandArgs) -> Result<Self, Failure> {
        let scene_2d = match is_scene(&args.input)?.then(|| opened::scene(&args.input)).transpose()? {
            Some(opened::Scene::ThreeD(scene_3d)) => return Self::for_3d(args, scene_3d),
            Some(opened::Scene::TwoD(file)) => Some(file),
            None => None,
        };
        if args.dataset.is_some() || args.shown.is_some() || args.up.is_some() {
            let message = "is no 3D scene, which alone has cameras, an order and a background to choose";
            return Err(Failure::usage(message).at(args.input.display()).mend("use --size alone"));
        }
        if let Some(file) = scene_2d {
            let canvas = canvas((file.width, file.height), args.size)?;
            return Ok(Self::TwoD { scene: file.scene, canvas, wanted: file.settings });
        }
        let target = Target::load(Some(&args.input), None).map_err(|error| match error {
            gs_io::Error::NotAnImage { .. } => Failure::from(error).mend("or name a scene that gs has written"),
            error => error.into(),
        })?;
        target.remarks.iter().for_each(output::note);
        canvas(target.image.size(), args.size)?;
        Ok(Self::Image { target: Box::new(target), size: args.size })
    }

    fn for_3d(args: &EffectsCommandArgs, opened: Opened3d) -> Result<Self, Failure> {
        opened.note_guess(&args.shown);
        let scene = &opened.file.scene;
        let most = args.views as usize;
        let Some(path) = &args.dataset else {
            let up = args.up.map_or(cameras::UP, |axis| axis.0);
            let bulk = cameras::bulk_of(scene)?;
            let first = cameras::overview(&bulk, args.size, up)?;
            first.validate().map_err(|error| Failure::usage(error).at("--size"))?;
            let cameras = Orbit { center: bulk.center, axis: up, frames: args.views }.cameras(&first);
            let wanted = opened.settings(&args.shown, None);
            let seen = format!("{} around it", counted(most, "place"));
            return Ok(Self::ThreeD { scene: opened.file.scene, cameras, wanted, seen });
        };
        let dataset = args.reading.read(path)?;
        let wanted = opened.settings(&args.shown, Some(&dataset));
        let Views { train, test, .. } = Views::of_dataset(&dataset);
        let (views, which) = if test.is_empty() { (train, "view") } else { (test, "test view") };
        let all: Vec<Camera> = views.iter().map(|PosedView { camera, .. }| *camera).collect();
        let sized = |camera: Camera| args.size.map_or(camera, |size| camera.resized(size.width, size.height));
        let cameras: Vec<Camera> = sampled(&all, most).into_iter().map(sized).collect();
        for camera in &cameras {
            camera.validate().map_err(|error| Failure::usage(error).at("--size"))?;
        }
        let seen = format!("{} of {} of {}", cameras.len(), counted(all.len(), which), path.display());
        Ok(Self::ThreeD { scene: opened.file.scene, cameras, wanted, seen })
    }
}

struct Examine<'a> {
    subject: Subject,
    args: &'a EffectsCommandArgs,
    backend: &'a Backend,
}

impl Task for Examine<'_> {
    type Output = Result<Report, Failure>;

    fn run<R: Optimizer<Scene2d> + Optimizer<Scene3d>>(self, rasterizer: &R) -> Self::Output {
        let Self { subject, args, backend } = self;
        let facts = |seen: String, gaussians: usize, width: u32, height: u32| Facts {
            input: args.input.display().to_string(),
            gaussians,
            seen,
            width,
            height,
            machine: backend.reason.clone(),
        };
        match subject {
            Subject::ThreeD { scene, cameras, wanted, seen } => {
                let facts = facts(seen, scene.len(), cameras[0].width, cameras[0].height);
                examine(rasterizer, &scene, &cameras, &wanted, args, facts)
            }
            Subject::TwoD { scene, canvas, wanted } => {
                let facts = facts("its canvas".to_owned(), scene.len(), canvas.width, canvas.height);
                examine(rasterizer, &scene, &[canvas], &wanted, args, facts)
            }
            Subject::Image { target, size } => {
                let flags = SettingsArgs { iterations: Some(ITERATIONS), ..SettingsArgs::default() };
                let settings = settings::resolve(&flags, &Given::Nothing, &target)?;
                let (steps, wanted) = (settings.iterations, settings.render);
                output::note(format_args!("fitting {} in {} first", target.name(), counted(steps, "step")));
                let mut trainer = Trainer::new(rasterizer, &target.image, settings).block_on()?;
                trainer.run(&mut ()).block_on()?;
                let scene = trainer.scene().block_on()?;
                let canvas = canvas(target.image.size(), size)?;
                let seen = format!("its canvas, after {}", counted(steps, "step"));
                let facts = facts(seen, scene.len(), canvas.width, canvas.height);
                examine(rasterizer, &scene, &[canvas], &wanted, args, facts)
            }
        }
    }
}

fn examine<S: RequiresEffects, R: Optimizer<S>>(
    rasterizer: &R,
    scene: &S,
    views: &[S::View],
    wanted: &RenderSettings,
    args: &EffectsCommandArgs,
    facts: Facts,
) -> Result<Report, Failure> {
    let splats = rasterizer.upload(scene, Parameterization::ScaleRotation)?;
    let sight = UploadedScene { rasterizer, splats: &splats, views };
    let proof = prove(scene, &sight, wanted)?;
    let prices = prices(&sight, wanted, &proof.called.settings, args.repetitions as usize)?;
    Ok(Report { facts, proof, prices })
}
