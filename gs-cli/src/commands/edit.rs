//! `gs edit`: operations on a 3D scene, one after the other.

use std::{
    fmt::Write as _,
    path::{Path, PathBuf},
    str::FromStr,
};

use clap::Args;
use gs_core::{Scene as _, counted};
use gs_io::{ConversionLoss, Edit, EditError, File3d, Format3d, WorldFrame, WriteOptions3d};
use serde::Serialize;

use crate::{
    failure::Failure,
    files::{output_folder, scene},
    terminal::output,
};

const AFTER_HELP: &str = "\
Operations, done from left to right:
  move=X,Y,Z: move, in units of the scene
  turn=AXIS:DEGREES: turn about x, y, z or an axis X,Y,Z through the origin, right-handed
  scale=FACTOR: scale about the origin
  scale-from=X,Y,Z,X,Y,Z,LENGTH: scale so that two points are LENGTH apart
  up=X,Y,Z: turn so that this direction points up, which is -y
  up=ground: turn so that the ground is level: the plane, at most 45 degrees from level, that holds most Gaussians
  crop=REGION: remove what is outside a region
  cut=REGION: remove what is inside a region
  keep=FILTER: remove Gaussians for which a filter is false
  drop=FILTER: remove Gaussians for which a filter is true
  add=FILE: add the Gaussians of another file

Regions: box:X,Y,Z,X,Y,Z (two corners), sphere:X,Y,Z,RADIUS, plane:X,Y,Z,OFFSET (where X x + Y y + Z z >= OFFSET), \
polygon:X,Z,X,Z,X,Z (seen from above). What lies in a region is decided by the means of the Gaussians.

Filters: opacity, size, thickness, x, y, z, red, green or blue; <, <=, > or >=; a number. Opacity and colours are 0 to 1; \
size and thickness are standard deviations of the longest and the shortest axis. Quote filters for the shell: \
'drop=opacity<0.02'.

What moves, turns or scales a scene takes it out of its place in the world of its data set. gs convert --frame world \
writes the coordinates of that world.

Example:
  gs edit out room.ply 'drop=opacity<0.02' up=ground scale-from=0,0,0,1,0,0,2.5 crop=sphere:0,0,0,4";

/// The flags of `gs edit`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct EditArgs {
    /// The 3D scene: a scene file, a checkpoint, or the output folder of gs train
    scene: PathBuf,
    #[arg(help = format!("The file to write, with the ending of its format: {}", Format3d::endings()))]
    to: PathBuf,
    /// What to do; see below
    #[arg(required = true, value_name = "OPERATION", allow_negative_numbers = true)]
    operations: Vec<Operation>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// An operation, as it was written and as it is done.
#[derive(Debug, Clone)]
struct Operation {
    text: String,
    edit: Edit,
}

impl FromStr for Operation {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Ok(Self { text: text.to_owned(), edit: text.parse()? })
    }
}

impl Operation {
    /// Does it, and says what it did.
    fn apply(&self, file: &mut File3d) -> Result<String, Failure> {
        let done = self.edit.apply(&mut file.scene, &mut file.trained_with.frame).map_err(|error| match error {
            EditError::Read(error) => Failure::of_scene(*error),
            EditError::NoGround => Failure::failed(error),
            _ => Failure::usage(error),
        });
        let done = done.map_err(|failure| failure.at(&self.text))?;
        Ok(format!("{}: {done}", self.text))
    }
}

/// What `gs edit --json` prints.
#[derive(Debug, Serialize)]
struct Report {
    read: String,
    written: String,
    format: String,
    /// Gaussians before.
    from: usize,
    /// Gaussians in the file.
    gaussians: usize,
    /// What each operation did, in words.
    operations: Vec<String>,
    /// The frame of the written coordinates in the world of the data set, if they have one.
    frame: Option<WorldFrame>,
    /// What the file lacks, in words.
    lost: Vec<String>,
}

/// Edits a scene.
pub(crate) fn run(args: &EditArgs) -> Result<(), Failure> {
    if Format3d::to_write(&args.to).is_none() {
        return Err(Format3d::unknown_ending(&args.to).into());
    }
    let others = args.operations.iter().filter_map(|operation| match &operation.edit {
        Edit::Add(path) => Some(path),
        _ => None,
    });
    let mut inputs: Vec<PathBuf> = others.chain([&args.scene]).map(|path| scene::file_of(path)).collect();
    output_folder::check_file(&args.to, &inputs)?;
    let mut file = scene::read_3d(&args.scene)?;
    output_folder::check_file(&args.to, &file.beside)?;
    inputs.extend(file.beside.iter().cloned());
    let from = file.scene.len();
    let operations = args.operations.iter().map(|operation| operation.apply(&mut file)).collect::<Result<_, _>>()?;
    let report = write(args, &inputs, file, from, operations)?;
    output::answer(args.json, &report, || text(&report))
}

fn write(
    args: &EditArgs,
    inputs: &[PathBuf],
    file: File3d,
    from: usize,
    operations: Vec<String>,
) -> Result<Report, Failure> {
    let options = WriteOptions3d::default().with(|s| s.trained_with = file.trained_with);
    let beside = Format3d::to_write(&args.to).map(|format| format.beside(&args.to, file.scene.sh_degree, &options));
    beside.iter().flatten().try_for_each(|path| output_folder::check_file(path, inputs))?;
    let written = gs_io::write_3d(&args.to, &file.scene, &options).map_err(Failure::of_scene)?;
    let path = |path: &Path| path.display().to_string();
    Ok(Report {
        read: path(&scene::file_of(&args.scene)),
        written: path(&args.to),
        format: written.format.to_string(),
        from,
        gaussians: file.scene.len(),
        operations,
        frame: Some(file.trained_with.frame).filter(|frame| !frame.is_world()),
        lost: file.losses.iter().chain(&written.losses).map(ConversionLoss::to_string).collect(),
    })
}

fn text(report: &Report) -> String {
    let mut text = format!("read        {}: {}", report.read, counted(report.from, "Gaussian"));
    report.operations.iter().for_each(|done| _ = write!(text, "\ndone        {done}"));
    let gaussians = counted(report.gaussians, "Gaussian");
    let _ = write!(text, "\nwrote       {}: {}, {gaussians}", report.written, report.format);
    report.lost.iter().for_each(|loss| _ = write!(text, "\nlost        {loss}"));
    text
}
