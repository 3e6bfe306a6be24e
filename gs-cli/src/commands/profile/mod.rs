//! `gs profile`: the time of each stage of a training step, on any backend.

mod measure;
mod report;
mod scene2d;
mod scene3d;

use std::path::PathBuf;

use clap::Args;
use gs_core::{Blend, Loss, Parameterization};
use gs_io::{AnyScene, Inputs};

use self::{measure::measure, scene2d::Input2d, scene3d::Input3d};
use crate::{
    backend::BackendArgs,
    dataset::ReadingArgs,
    failure::Failure,
    memory, output,
    output_folder::{self, OutputFolder, OverwriteArgs},
    render_args::RenderArgs3d,
    scene,
    values::{Size, ViewName, by_name, whole},
};

const AFTER_HELP: &str = "\
A scene is profiled as it is: a 3D scene from a view of a data set, or from where all of it is in \
sight. An image is fitted first, in a few steps on the same backend. The measured steps do not \
move the Gaussians.

A row of the table is a stage of a training step: its median time, its 10 % and 90 % quantiles, \
its share of the sum, and the pairs of a pixel and a Gaussian that it visits in a second. A stage \
that a training step replaces by another has no share. Below are whole training steps (means over \
4, sent without waiting, as in a fit), with new lists and with those of the step before (in 3D \
always new), and the forward pass alone, as a caller sees them.

On a GPU, stages are timed by the device if the adapter has timestamps, otherwise by the host, \
which then waits after each stage. The head of the table says which.

DIR then holds profile.csv, the table, and profile.json, which --json prints: the same with all \
samples and settings.";

/// The flags of `gs profile`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct ProfileArgs {
    /// A scene, or an image to fit first [default: the paper's circle and square, 128x128]
    input: Option<PathBuf>,
    /// Folder for profile.csv and profile.json; made if necessary [default: the table is only
    /// printed]
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Print JSON on standard output, and nothing else there
    #[arg(long)]
    json: bool,
    /// Measurements of each stage
    #[arg(short, long, value_name = "R", default_value_t = 20, value_parser = whole::<u32>(1..=100_000))]
    repetitions: u32,
    /// Size of the canvas [default: that of the image, the scene or the view; otherwise 800x600]
    #[arg(long, value_name = "WxH")]
    size: Option<Size>,
    /// The target of a scene, an image of the canvas' size [default: the scene's own rendering]
    #[arg(long, value_name = "IMAGE")]
    image: Option<PathBuf>,
    /// The most Gaussians to fit an image with [default: 9000 for each 768x512 px]
    #[arg(short = 'n', long, value_name = "N", value_parser = whole::<u32>(1..))]
    gaussians: Option<u32>,
    /// Steps to fit an image [default: 100]
    #[arg(short, long, value_name = "K", value_parser = whole::<u32>(0..))]
    iterations: Option<u32>,
    /// Loss to minimise [default: l2; l1-dssim for the circle and square and in 3D]
    #[arg(long, value_parser = by_name::<Loss>(), value_name = "LOSS")]
    loss: Option<Loss>,
    /// How the Gaussians at a pixel become its colour [default: that of the scene; sum for images,
    /// over in 3D]
    #[arg(long, value_parser = by_name::<Blend>(), value_name = "BLEND")]
    blend: Option<Blend>,
    /// Coordinates of the optimizer [default: covariance-factor; scale-rotation for the circle and
    /// square and in 3D]
    #[arg(long, value_parser = by_name::<Parameterization>(), value_name = "NAME")]
    parameterization: Option<Parameterization>,
    /// Camera of a view of a data set [default: the whole scene from slightly above]
    #[arg(long, value_name = "DATASET:VIEW", help_heading = "3D scenes")]
    camera: Option<ViewName>,
    #[command(flatten)]
    reading: ReadingArgs,
    #[command(flatten)]
    render: RenderArgs3d,
    #[command(flatten)]
    backend: BackendArgs,
}

/// What is profiled, of either kind.
enum Input {
    TwoD(Box<Input2d>),
    ThreeD(Box<Input3d>),
}

/// Profiles a scene or an image, prints the table, and writes it to files if a folder for them is
/// named.
pub(crate) fn run(args: &ProfileArgs) -> Result<(), Failure> {
    let inputs = [&args.input, &args.image].into_iter().flatten();
    let inputs: Inputs = inputs.map(|path| scene::file_of(path)).collect();
    let claim = args.output.as_ref().map(|path| args.overwrite.claim(path, ["profile.csv", "profile.json"], inputs));
    claim.as_ref().map_or(Ok(()), output_folder::check)?;
    let input = match &args.input {
        Some(path) => match scene::read_if_any(path)? {
            Some(AnyScene::ThreeD(file)) => Input::ThreeD(Box::new(Input3d::of_scene(path, *file, args)?)),
            Some(AnyScene::TwoD(file)) => Input::TwoD(Box::new(Input2d::of_scene(path, *file, args)?)),
            None => Input::TwoD(Box::new(Input2d::of_image(Some(path), args)?)),
        },
        None => Input::TwoD(Box::new(Input2d::of_image(None, args)?)),
    };
    let (path, size) = match &input {
        Input::TwoD(input) => (input.name.as_str(), (input.canvas.width, input.canvas.height)),
        Input::ThreeD(input) => (input.name.as_str(), (input.camera.width, input.camera.height)),
    };
    memory::check_work("profiling", path, size, gs_train::memory::profiling(size))?;
    let backend = match &input {
        Input::TwoD(input) => args.backend.open_to_render_2d(&input.render),
        Input::ThreeD(_) => args.backend.open(),
    }?;
    let folder = claim.map(OutputFolder::begin).transpose()?;
    let repetitions = args.repetitions as usize;
    let report = match input {
        Input::TwoD(input) => measure(input.prepare(&backend.rasterizer)?, &backend, repetitions),
        Input::ThreeD(input) => measure(input.prepare(&backend.rasterizer)?, &backend, repetitions),
    }?;
    if let Some(folder) = &folder {
        folder.write("profile.csv", report.csv())?;
        folder.write_json("profile.json", &report)?;
        output::note(format_args!("wrote profile.csv and profile.json in {}", folder.path().display()));
    }
    if args.json { output::json(&report) } else { output::result(report.text()) }
}
