//! `gs popping`: how much a 3D scene flickers while the camera moves, in both orders of blending or by its levels of
//! detail.

use std::path::PathBuf;

use clap::Args;
use gs_backend::FutureExt as _;
use gs_core::{Rasterizer as _, Scene as _, counted};
use gs_io::Inputs;
use gs_lab::price::{SlowOrbit, popping_prices, popping_prices_of_levels};

use super::{SeenArgs, around};
use crate::{
    failure::Failure,
    files::{
        lod::Lod,
        output_folder::{self, OutputFolder, OverwriteArgs},
        scene,
    },
    flags::{render_args::why_empty, values::whole},
    terminal::output,
};

const AFTER_HELP: &str = "\
The camera moves around the scene in short stretches. Each frame is rendered in both orders: \
sorted by the depth of the means (global, as in 3DGS) and by the depth at each pixel (per-pixel).

With --max-gaussians, each frame is rendered from the levels of detail that it needs, once with levels \
that change at once, and once with the transitions of gs view, at 60 frames a second.

Popping is measured by the second difference of three frames, averaged over SSIM's window. At half \
the step, a quarter of the motion remains, but all of a jump. So each number is given for three \
steps: what stays the same is popping, what falls is motion.

DIR then holds popping.csv, the table; flicker-chart.svg, frame by frame; and popping.png, two consecutive frames with the worst popping in both \
ways, and their differences.";

/// The flags of `gs popping`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct PoppingArgs {
    /// The 3D scene: a scene file, a checkpoint, or the output folder of gs train
    scene: PathBuf,
    /// Folder for the results; made if necessary
    #[arg(short, long, value_name = "DIR", default_value = "gs-popping")]
    output: PathBuf,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// The largest step between frames, degrees; half and a quarter of it are measured, too
    #[arg(long, value_name = "DEGREES", default_value_t = 0.25)]
    step: f32,
    /// Frames of a stretch, a quarter of the step apart
    #[arg(long, value_name = "N", default_value_t = 13, value_parser = whole::<u32>(9..=10_000))]
    frames: u32,
    /// Stretches of the orbit, evenly spread
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = whole::<u32>(1..=10_000))]
    places: u32,
    /// Compare levels of detail that change at once with transitions, at most N Gaussians a frame
    #[arg(long, value_name = "N", value_parser = whole::<u32>(1..))]
    max_gaussians: Option<u32>,
    #[command(flatten)]
    seen: SeenArgs,
}

/// The files that are written.
const FILES: [&str; 3] = ["popping.csv", "flicker-chart.svg", "popping.png"];

/// Measures, prints the table and writes the files.
pub(crate) fn run(args: &PoppingArgs) -> Result<(), Failure> {
    let flags = &args.seen.render;
    if flags.order.is_some() && args.max_gaussians.is_none() {
        return Err(Failure::usage("--order: both orders are compared").hint("leave it out"));
    }
    let claim = args.overwrite.claim(&args.output, FILES, Inputs::from_iter([scene::file_of(&args.scene)]));
    output_folder::check(&claim)?;
    let lod = args.max_gaussians.map(|budget| Lod::open(&args.scene, budget)).transpose()?;
    let file = lod.as_ref().map_or_else(|| scene::read_3d(&args.scene), Lod::coarsest)?;
    let (orbit, first) = around(&file, &args.seen, args.places)?;
    let flight = SlowOrbit::new(orbit, args.frames, args.step);
    flight.stretches(&first).map_err(|error| Failure::usage(error).at("--size, --step, --frames or --places"))?;
    let folder = OutputFolder::begin(claim)?;
    let backend = args.seen.backend.open()?;
    output::note(&backend.reason);
    flags.note_guess(&file);
    let (rasterizer, scene, render) = (&backend.rasterizer, &file.scene, flags.settings(&file, None));
    let name = args.scene.file_stem().map_or_else(|| "scene".into(), |stem| stem.to_string_lossy());
    let all = lod.as_ref().map_or(scene.len(), Lod::finest);
    let what = format!("{name}, {}", counted(all, "Gaussian"));
    let culled = {
        let splats = rasterizer.upload(scene, gs_core::Parameterization::ScaleRotation)?;
        rasterizer.for_3d().draw(&splats, &first, &render).block_on()?.1
    };
    if let Some(why) = why_empty(culled, scene.len(), 1) {
        output::note(format_args!("note: nothing of the scene is in the first frame: {why}"));
    }
    let findings = match &lod {
        Some(lod) => popping_prices_of_levels(rasterizer, lod.levels(), &flight, &first, &render, &what)?,
        None => popping_prices(rasterizer, scene, &flight, &first, &render, &what)?,
    };
    folder.write_all(findings.files())?;
    output::result(findings.to_string().trim_end())?;
    output::note(format_args!("see {}", folder.path().display()));
    Ok(())
}
