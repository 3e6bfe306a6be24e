//! `gs popping`: how much jumps in a 3D scene while the camera moves, by one depth a Gaussian and by the depth at each pixel.

use pollster::FutureExt as _;
use std::path::PathBuf;

use clap::Args;
use gs_core::{Camera, Optimizer, Parameterization, RenderSettings, Scene, Scene3d, counted, view::Orbit};
use gs_io::Inputs;
use gs_lab::experiments::{
    Findings, Table,
    popping::{Comparison, STRIDES, SlowOrbit, compare},
};

use crate::{
    backend::{Backend, BackendArgs, Task3d},
    cameras,
    failure::Failure,
    opened, output,
    output_folder::{self, OutputFolder, OverwriteArgs},
    paper::write_findings,
    shown::{ShownArgs, why_empty},
    values::{Axis, Size, whole},
};

const AFTER_HELP: &str = "\
The camera goes around the scene in short stretches; each frame is rendered sorted by one depth a Gaussian (global, as 3DGS does) and \
by the depth at each pixel (per-pixel). What jumps is told from motion by the second difference of three frames, averaged under SSIM's \
window: half the step leaves a quarter of motion's and all of a jump's. So each number is given for three steps; what stays from one to the \
next is popping, what falls with the step is motion.

DIR then holds popping.csv, the table; flicker-chart.csv, .png and .svg, frame by frame; and popping.png, where it shows best: two frames in \
a row in both orders, and their differences.";

/// The flags of `gs popping`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct PoppingArgs {
    /// The 3D scene: PLY, .splat, SPZ, glTF, a checkpoint, or the output folder of gs train
    scene: PathBuf,
    /// Folder for the results; made if it is not there
    #[arg(short, long, value_name = "DIR", default_value = "gs-popping")]
    output: PathBuf,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Size of the pictures [default: 800x600]
    #[arg(long, value_name = "WxH")]
    size: Option<Size>,
    /// The axis that the camera goes around and that is up in the picture: x, y, z, or -x, -y, -z [default: -y]
    #[arg(long, value_name = "AXIS", allow_hyphen_values = true)]
    up: Option<Axis>,
    /// The coarsest step between frames, degrees; a half and a quarter of it are looked at, too
    #[arg(long, value_name = "DEGREES", default_value_t = 0.25)]
    step: f32,
    /// Frames of a stretch, a quarter of the step apart
    #[arg(long, value_name = "N", default_value_t = 13, value_parser = whole::<u32>(9..=10_000))]
    frames: u32,
    /// Stretches of the orbit, evenly spread
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = whole::<u32>(1..=10_000))]
    places: u32,
    #[command(flatten)]
    shown: ShownArgs,
    #[command(flatten)]
    backend: BackendArgs,
}

/// The files that are written.
const FILES: [&str; 5] = ["popping.csv", "flicker-chart.csv", "flicker-chart.png", "flicker-chart.svg", "popping.png"];

/// Measures, prints the table and writes the files.
///
/// # Errors
/// Where the scene cannot be read, what is asked for is not possible, the backend has not both orders, or a file cannot be written.
pub(crate) fn run(args: &PoppingArgs) -> Result<(), Failure> {
    if args.shown.has_order() {
        return Err(Failure::usage("--order: both orders are compared").mend("leave it out"));
    }
    let claim = args.overwrite.claim(&args.output, FILES, Inputs::from_iter([opened::file_of(&args.scene)]));
    output_folder::check(&claim)?;
    let opened = opened::scene_3d(&args.scene)?;
    let scene = &opened.file.scene;
    let bulk = cameras::bulk_of(scene)?;
    let up = args.up.map_or(cameras::UP, |axis| axis.0);
    let first = cameras::overview(&bulk, args.size, up)?;
    let orbit = Orbit { center: bulk.center, axis: up, frames: args.places };
    first.validate().map_err(|error| Failure::usage(error).at("--size"))?;
    let flight = SlowOrbit { orbit, frames: args.frames, step_degrees: args.step / STRIDES[STRIDES.len() - 1] as f32 };
    flight.stretches(&first).map_err(|error| Failure::usage(error).at("--size, --step, --frames or --places"))?;
    let folder = OutputFolder::begin(claim)?;
    let backend = Backend::start(&args.backend)?;
    output::note(&backend.reason);
    opened.note_guess(&args.shown);
    let render = opened.settings(&args.shown, None);
    let name = args.scene.file_stem().map_or_else(|| "scene".into(), |stem| stem.to_string_lossy());
    let what = format!("{name}, {}", counted(scene.len(), "Gaussian"));
    let findings = backend.run_3d(Fly { scene, flight, first, render, what })?;
    write_findings(&folder, "", &findings)?;
    for table in &findings.tables {
        output::result(text(table))?;
    }
    output::note(format_args!("see {}", folder.path().display()));
    Ok(())
}

struct Fly<'a> {
    scene: &'a Scene3d,
    flight: SlowOrbit,
    first: Camera,
    render: RenderSettings,
    what: String,
}

impl Task3d for Fly<'_> {
    type Output = Result<Findings, gs_train::Error>;

    fn run<R: Optimizer<Scene3d>>(self, rasterizer: &R) -> Self::Output {
        let Self { scene, flight, first, render, what } = self;
        let frame = rasterizer
            .forward(&rasterizer.upload(scene, Parameterization::ScaleRotation)?, &first, &render)
            .block_on()?;
        if let Some(why) = why_empty(rasterizer.culled(&frame), scene.len(), 1) {
            output::note(format_args!("note: nothing of the scene is in the first frame: {why}"));
        }
        drop(frame);
        let compared: Comparison = compare(rasterizer, scene, &flight, &first, &render)?;
        let picture = compared.picture(rasterizer, scene, &render, &what)?;
        Ok(compared.findings(&what, picture))
    }
}

/// A table in columns as wide as their widest cell.
fn text(table: &Table) -> String {
    let rows: Vec<Vec<String>> = std::iter::once(table.columns.iter().map(ToString::to_string).collect())
        .chain(table.rows.iter().map(|row| row.iter().map(ToString::to_string).collect()))
        .collect();
    let width = |column: usize| rows.iter().map(|row: &Vec<String>| row[column].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..table.columns.len()).map(width).collect();
    let line = |row: &Vec<String>| {
        let cells = row.iter().zip(&widths).map(|(cell, &width)| format!("{cell:>width$}"));
        cells.collect::<Vec<_>>().join("  ")
    };
    std::iter::once(table.title.clone()).chain(rows.iter().map(line)).collect::<Vec<_>>().join("\n")
}
