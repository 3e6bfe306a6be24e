//! `gs convert`: a scene into another format, and what is lost.

mod reduction;
mod scene2d;

use std::{
    fmt::Write,
    path::{Path, PathBuf},
};

use clap::Args;
use gs_core::{
    Scene, Scene3d, counted,
    examination::{self, Repair},
};
use gs_io::{
    AnyScene, ConversionLoss, Coordinates, File3d, Format3d, SCENE_EXTENSION, SceneFile, SpzVersion, TrainedWith,
    Values, WorldFrame, WriteOptions3d, dataset::Dataset,
};
use serde::Serialize;

use self::reduction::{Reduction, ReductionArgs};
use crate::{
    failure::Failure,
    files::{output_folder, scene},
    flags::values::by_name,
    terminal::output,
};

const AFTER_HELP: &str = "\
A .gsi file or a checkpoint of a 2D scene can be written as .gs2d.safetensors, without loss; a \
transparent .gsi file is placed on white.";

/// The flags of `gs convert`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct ConvertArgs {
    #[arg(help = format!(
        "The scene: {}, recognised by content; a 2D scene (.gs2d.safetensors or .gsi), a checkpoint, or the output \
         folder of gs fit or gs train",
        Format3d::names()
    ))]
    from: PathBuf,
    #[arg(help = format!(
        "The file to write, with the ending of its format: {}; meta.json for a SOG as images in its folder, \
         lod-meta.json for a streamed SOG and tileset.json for 3D Tiles, both with levels of detail; for a 2D scene \
         .gs2d.safetensors",
        Format3d::endings()
    ))]
    to: PathBuf,
    /// Version of an SPZ: 4 is smaller, 3 is for readers older than 2026
    #[arg(long, value_name = "VERSION", value_parser = by_name::<SpzVersion>(), default_value_t)]
    spz_version: SpzVersion,
    /// Coordinates of the file: those of the scene, or those of the world of its data set, from which
    /// training may have moved the scene. Far from the world's origin, only PLY (means of 64 bits) and
    /// glTF (a node) hold the latter
    #[arg(long, value_name = "COORDINATES", value_parser = by_name::<Coordinates>(), default_value_t)]
    frame: Coordinates,
    /// EPSG code of the data set's coordinates, for a place of 3D Tiles on the globe: 4978 for ECEF, or a zone of UTM,
    /// such as 32632 for zone 32 north
    #[arg(long, value_name = "CODE")]
    epsg: Option<u16>,
    /// Repair scales of 0, leave out Gaussians that cannot be drawn or that the format cannot hold, and print
    /// how many; gs doctor shows which and why
    #[arg(long)]
    drop_broken: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    reduction: ReductionArgs,
}

/// What `gs convert --json` prints.
#[derive(Debug, Serialize)]
struct Conversion {
    read: Side,
    written: Side,
    gaussians: usize,
    sh_degree: u8,
    /// The frame of the written coordinates; `null` for those of the world.
    frame: Option<WorldFrame>,
    /// Gaussians that `--drop-broken` left out.
    dropped: usize,
    /// Those among them that could be drawn, but not be stored in this format.
    beyond_format: usize,
    /// What `--gaussians` merged and removed.
    reduction: Option<Reduction>,
    /// What the written file lacks, in words.
    lost: Vec<String>,
}

#[derive(Debug, Serialize)]
struct Side {
    file: String,
    format: String,
    /// Size of the file, with the buffer of a glTF.
    bytes: u64,
    bytes_per_gaussian: f64,
}

impl Side {
    fn new(path: &Path, format: Format3d, bytes: u64, gaussians: usize) -> Self {
        let bytes_per_gaussian = bytes as f64 / gaussians as f64;
        Self { file: path.display().to_string(), format: format.to_string(), bytes, bytes_per_gaussian }
    }
}

/// Converts a scene.
pub(crate) fn run(args: &ConvertArgs) -> Result<(), Failure> {
    if Format3d::to_write(&args.to).is_none() && !scene::is_scene_2d(&args.to) {
        let failure = Failure::from(Format3d::unknown_ending(&args.to));
        return Err(failure.hint(format_args!("or, for a 2D scene, .{SCENE_EXTENSION}")));
    }
    if args.epsg.is_some() && Format3d::to_write(&args.to) != Some(Format3d::Tiles3d) {
        let failure = Failure::usage("only 3D Tiles have a place on the globe").at("--epsg");
        return Err(failure.hint("write them as FOLDER/tileset.json"));
    }
    let values = if args.drop_broken { Values::Any } else { Values::Checked };
    let SceneFile { path, scene, has_alpha, .. } = scene::read(&args.from, values)?;
    let mut inputs = vec![path.clone()];
    let mut dataset = None;
    if let AnyScene::ThreeD(file) = &scene {
        inputs.extend(file.beside.iter().cloned());
        dataset = args.reduction.dataset(file)?;
    }
    inputs.extend(dataset.iter().flat_map(Dataset::files));
    output_folder::check_file(&args.to, &inputs)?;
    let mut file = match scene {
        AnyScene::TwoD(_) if args.reduction.gaussians.is_some() => {
            let failure = Failure::usage("--gaussians is for 3D scenes, but this is a 2D scene").at(path.display());
            return Err(failure.hint("gs fit -n N fits the image with fewer"));
        }
        AnyScene::TwoD(file) => return scene2d::run(args, &path, *file, has_alpha),
        AnyScene::ThreeD(file) => *file,
    };
    if scene::is_scene_2d(&args.to) {
        let message = "cannot write a 3D scene in this format, which holds only 2D scenes";
        return Err(Failure::usage(message)
            .at(args.to.display())
            .hint(format_args!("use {}, or draw a PNG with gs render", Format3d::endings())));
    }
    let (all, mut losses, mut beyond_format) = (file.scene.len(), std::mem::take(&mut file.losses), 0);
    if args.drop_broken {
        let Repair { widened, .. } = examination::repair(&mut file.scene)?;
        losses.extend((widened > 0).then_some(ConversionLoss::ZeroScales { gaussians: widened }));
        beyond_format = drop_beyond_format(&mut file.scene, &args.to, &options(args, file.trained_with));
        if file.scene.is_empty() && all > 0 {
            return Err(none_is_left(all, &args.to));
        }
    }
    file.trained_with = args.reduction.render.trained_with(file.trained_with);
    let reduction = args.reduction.reduce(&mut file, dataset.as_ref())?;
    let options = options(args, file.trained_with);
    let beside = Format3d::to_write(&args.to).map(|format| format.beside(&args.to, file.scene.sh_degree));
    beside.iter().flatten().try_for_each(|path| output_folder::check_file(path, &inputs))?;
    let File3d { scene, .. } = &file;
    let written = gs_io::write_3d(&args.to, scene, &options).map_err(|error| match error {
        gs_io::Error::InTheWay { .. } => Failure::failed(error).hint("write into another folder"),
        error => Failure::of_scene(error),
    })?;
    let size = |path: &Path| std::fs::metadata(path).map_or(0, |file| file.len());
    let bytes = size(&args.to) + written.beside.iter().map(|path| size(path)).sum::<u64>();
    let frame = if args.frame == Coordinates::World { WorldFrame::WORLD } else { file.trained_with.frame };
    let conversion = Conversion {
        read: Side::new(&path, file.format, file.bytes, all),
        written: Side::new(&args.to, written.format, bytes, scene.len()),
        gaussians: scene.len(),
        sh_degree: scene.sh_degree,
        frame: Some(frame).filter(|frame| !frame.is_world()),
        dropped: all - scene.len() - reduction.as_ref().map_or(0, Reduction::fewer),
        beyond_format,
        reduction,
        lost: losses.iter().chain(&written.losses).map(ConversionLoss::to_string).collect(),
    };
    if args.json { output::json(&conversion) } else { output::result(text(&conversion)) }
}

/// Removes the Gaussians that a file of this name cannot hold, and returns their number.
fn drop_beyond_format(scene: &mut Scene3d, to: &Path, options: &WriteOptions3d) -> usize {
    let beyond = Format3d::to_write(to).map_or_else(Vec::new, |format| format.cannot_hold(scene, options));
    if !beyond.is_empty() {
        let mut others = Scene3d { sh_degree: scene.sh_degree, ..Scene3d::default() };
        let held = (0..scene.len()).filter(|i| beyond.binary_search(i).is_err());
        held.for_each(|i| others.push(scene.gaussian(i)));
        *scene = others;
    }
    beyond.len()
}

/// How the file is written.
fn options(args: &ConvertArgs, trained_with: TrainedWith) -> WriteOptions3d {
    WriteOptions3d::default().with(|s| {
        s.trained_with = trained_with;
        s.coordinates = args.frame;
        s.spz_version = args.spz_version;
        s.epsg = args.epsg;
    })
}

/// The failure where `--drop-broken` leaves nothing of so many Gaussians.
fn none_is_left(all: usize, to: &Path) -> Failure {
    let message = format_args!("none of {} can be drawn and stored in this format", counted(all, "Gaussian"));
    Failure::failed(message).at(to.display()).hint("make the scene again; gs doctor says what is broken in it")
}

fn text(conversion: &Conversion) -> String {
    let Conversion { read, written, gaussians, sh_degree, frame, dropped, beyond_format, reduction, lost } = conversion;
    let side = |Side { file, format, bytes, bytes_per_gaussian }: &Side| {
        format!("{file}: {format}, {bytes} bytes, {bytes_per_gaussian:.1} a Gaussian")
    };
    let mut text = format!("read        {}\nGaussians   {gaussians}, SH degree {sh_degree}\n", side(read));
    frame
        .iter()
        .for_each(|frame| _ = writeln!(text, "frame       {frame}; --frame world writes the world's coordinates"));
    let why = ["cannot be drawn", "the format cannot hold"];
    for (dropped, why) in [dropped - beyond_format, *beyond_format].into_iter().zip(why).filter(|(n, _)| *n > 0) {
        let _ = writeln!(text, "dropped     {} that {why}", counted(dropped, "Gaussian"));
    }
    reduction.iter().for_each(|reduction| _ = writeln!(text, "reduced     {reduction}"));
    let _ = write!(text, "wrote       {}", side(written));
    if lost.is_empty() {
        text += "\nlost        nothing";
    }
    lost.iter().for_each(|loss| _ = write!(text, "\nlost        {loss}"));
    text
}
