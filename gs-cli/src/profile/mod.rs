//! `gs profile`: where the time of a training step goes, stage by stage, on any backend.

mod measure;
mod report;
mod scene3d;
mod subject;

use std::path::PathBuf;

use clap::Args;
use gs_io::Inputs;
use gs_train::is_scene;

use crate::{
    backend::{Backend, BackendArgs},
    dataset::ReadingArgs,
    failure::Failure,
    fit::arguments::BlendName,
    opened::{self, Scene},
    output,
    output_folder::{self, OutputFolder, OverwriteArgs},
    profile::{measure::Measure, scene3d::Subject3d, subject::Subject},
    shown::ShownArgs,
    training_arguments::{LossName, ParameterizationName},
    values::{Size, ViewName, whole},
};

const AFTER_HELP: &str = "\
INPUT is taken as it comes: a scene is profiled as it is, one in 3D (PLY, .splat, SPZ, glTF) from a view of a data set or from where it \
is seen whole; an image, or the circle and square, is fitted first, in a few steps and on the same backend, and then profiled with the \
Gaussians as they are. No step that is measured moves them.

A row of the table is a stage of a training step: its median time and 10 % and 90 % quantiles; its share of the sum; the pairs of a \
pixel and a Gaussian that it visits in a second. A stage that a \
training step does not run, because another one does its work in the same pass, has no share. Below stand whole training steps (means \
over 4, sent one behind the other as in a fit), with lists made anew and with those of the step before (in 3D always anew), and the forward pass alone, as \
a caller sees them.

On a GPU the stages' times are the device's own where the adapter has timestamps, and those of the host otherwise, waiting after each \
stage; the head of the table says which.

DIR then holds profile.csv, the table, and profile.json, the same with all samples and what was measured on what; --json prints that.";

/// The flags of `gs profile`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct ProfileArgs {
    /// A scene, or an image to which Gaussians are fitted first [default: the paper's circle and square, 128x128]
    input: Option<PathBuf>,
    /// Folder for profile.csv and profile.json; made if it is not there [default: the table is only printed]
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Print JSON on standard output, and nothing else there
    #[arg(long)]
    json: bool,
    /// How often each stage is measured
    #[arg(short, long, value_name = "R", default_value_t = 20, value_parser = whole::<u32>(1..=100_000))]
    repetitions: u32,
    /// Size of the canvas [default: that of the image, or of the one that the scene was made for; in 3D that of the view, or 800x600]
    #[arg(long, value_name = "WxH")]
    size: Option<Size>,
    /// What a scene is compared with, an image of the canvas' size [default: its own rendering]
    #[arg(long, value_name = "IMAGE")]
    image: Option<PathBuf>,
    /// The most Gaussians that an image is fitted with [default: 9000 for each 768x512 px]
    #[arg(short = 'n', long, value_name = "N", value_parser = whole::<u32>(1..))]
    gaussians: Option<u32>,
    /// Steps in which an image is fitted [default: 100]
    #[arg(short, long, value_name = "K", value_parser = whole::<u32>(0..))]
    iterations: Option<u32>,
    /// What is minimised [default: l2; l1-dssim for the circle and square and in 3D]
    #[arg(long, value_enum, value_name = "LOSS")]
    loss: Option<LossName>,
    /// How the Gaussians at a pixel become its colour [default: as the scene has it; sum for images, over in 3D]
    #[arg(long, value_enum, value_name = "BLEND")]
    blend: Option<BlendName>,
    /// In which coordinates the optimiser moves [default: covariance-factor; scale-rotation for the circle and square and in 3D]
    #[arg(long, value_enum, value_name = "NAME", alias = "chart")]
    parameterization: Option<ParameterizationName>,
    /// From where a photograph of a data set was taken [default: the whole scene from a little above]
    #[arg(long, value_name = "DATASET:VIEW", help_heading = "Scenes in 3D")]
    camera: Option<ViewName>,
    #[command(flatten)]
    reading: ReadingArgs,
    #[command(flatten)]
    shown: ShownArgs,
    #[command(flatten)]
    backend: BackendArgs,
}

/// What is profiled, of either kind.
enum AnySubject {
    TwoD(Box<Subject>),
    ThreeD(Box<Subject3d>),
}

/// Profiles a scene or an image, prints the table, and writes it to files if a folder for them is named.
///
/// # Errors
/// Where input, flags or the output folder are not possible, or the backend fails.
pub(crate) fn run(args: &ProfileArgs) -> Result<(), Failure> {
    let inputs = [&args.input, &args.image].into_iter().flatten();
    let inputs: Inputs = inputs.map(|path| opened::file_of(path)).collect();
    let claim = args.output.as_ref().map(|path| args.overwrite.claim(path, ["profile.csv", "profile.json"], inputs));
    claim.as_ref().map_or(Ok(()), output_folder::check)?;
    let subject = match &args.input {
        Some(path) if is_scene(path)? => match opened::scene(path)? {
            Scene::ThreeD(scene_3d) => AnySubject::ThreeD(Box::new(Subject3d::load(path, scene_3d, args)?)),
            Scene::TwoD(file) => AnySubject::TwoD(Box::new(Subject::load(Some(file), args)?)),
        },
        _ => AnySubject::TwoD(Box::new(Subject::load(None, args)?)),
    };
    let backend = match &subject {
        AnySubject::TwoD(subject) => Backend::start_for_image(&args.backend, &subject.render),
        AnySubject::ThreeD(subject) => Backend::start_in_space(&args.backend, subject.parameterization),
    }?;
    let folder = claim.map(OutputFolder::begin).transpose()?;
    let repetitions = args.repetitions as usize;
    let report = match subject {
        AnySubject::TwoD(subject) => backend.run(Measure { subject: *subject, backend: &backend, repetitions }),
        AnySubject::ThreeD(subject) => backend.run_3d(Measure { subject: *subject, backend: &backend, repetitions }),
    }?;
    if let Some(folder) = &folder {
        folder.write("profile.csv", report.csv())?;
        folder.write_json("profile.json", &report)?;
        output::note(format_args!("wrote profile.csv and profile.json in {}", folder.path().display()));
    }
    if args.json { output::json(&report) } else { output::result(report.text()) }
}
