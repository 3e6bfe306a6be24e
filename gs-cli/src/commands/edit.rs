//! `gs edit`: operations on a 3D scene, one after the other.

use std::{
    fmt::Write as _,
    path::{Path, PathBuf},
    str::FromStr,
};

use clap::Args;
use gs_backend::FutureExt as _;
use gs_core::{Image, Scene as _, counted};
use gs_io::{
    ConversionLoss, Done, Edit, EditError, File3d, Format3d, Parts3d, TrainedWith, WorldFrame, WriteOptions3d,
    Written3d, writes_parts_3d,
};
use gs_train::{edit::ViewEditor, train::Views};
use serde::Serialize;

use crate::{
    failure::Failure,
    files::{output_folder, scene},
    flags::{backend::BackendArgs, dataset::DatasetArgs, render_args::RenderArgs3d},
    memory,
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
  align=DATASET,DATASET: move so that the cameras of the first data set, that of the scene, come to those of the
    second with the same images
  crop=REGION: remove what is outside a region
  cut=REGION: remove what is inside a region
  keep=FILTER: remove Gaussians for which a filter is false
  drop=FILTER: remove Gaussians for which a filter is true
  add=FILE: add the Gaussians of another file
  floaters, floaters=DB: remove Gaussians that hang in front of what the training views show, as long as these views
    lose at most 0.05 dB, or DB, of their PSNR; with --views

Regions: box:X,Y,Z,X,Y,Z (two corners), sphere:X,Y,Z,RADIUS, plane:X,Y,Z,OFFSET (where X x + Y y + Z z >= OFFSET), \
polygon:X,Z,X,Z,X,Z (seen from above). What lies in a region is decided by the means of the Gaussians.

Filters: opacity, size, thickness, x, y, z, red, green, blue or contribution; <, <=, > or >=; a number. Opacity and colours are 0 to 1; \
size and thickness are standard deviations of the longest and the shortest axis. With --views there is also contribution: \
the sum of the blending weights of a Gaussian in the view where it is largest, in pixels. Quote filters for the shell: \
'drop=opacity<0.02'.

What moves, turns or scales a scene takes it out of its place in the world of its data set; align takes it \
to that of the other one. gs convert --frame world \
writes the coordinates of that world.

Example:
  gs edit out room.ply 'drop=opacity<0.02' up=ground scale-from=0,0,0,1,0,0,2.5 crop=sphere:0,0,0,4
  gs edit north both.ply align=north-photos,south-photos add=south
  gs edit out clean.ply --views dataset floaters 'keep=contribution>0.1'";

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
    /// The data set whose training views floaters and contribution are found with
    #[arg(long, value_name = "DATASET")]
    views: Option<PathBuf>,
    /// Write pictures of some views into this folder, with what floaters removes in magenta
    #[arg(long, value_name = "FOLDER", requires = "views")]
    preview: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    images: DatasetArgs,
    #[command(flatten)]
    render: RenderArgs3d,
    #[command(flatten)]
    backend: BackendArgs,
}

/// Pictures that `--preview` writes for an operation.
const PICTURES: usize = 4;

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
    fn failed(&self, error: impl Into<gs_train::Error>) -> Failure {
        let failure = match error.into() {
            gs_train::Error::Edit(EditError::Read(error)) => Failure::of_scene(*error),
            gs_train::Error::Edit(error @ EditError::NoGround) => Failure::failed(error),
            gs_train::Error::Edit(error) => Failure::usage(error),
            error => error.into(),
        };
        failure.at(&self.text)
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
    if let Some(operation) = args.operations.iter().find(|o| args.views.is_none() && o.edit.needs_views()) {
        let failure = Failure::usage("it needs views that show the scene").at(&operation.text);
        return Err(failure.hint("name their data set with --views"));
    }
    if args.preview.is_some() && !args.operations.iter().any(|o| matches!(o.edit, Edit::Floaters(_))) {
        return Err(Failure::usage("--preview shows what floaters removes").hint("add the operation floaters"));
    }
    let others = args.operations.iter().filter_map(|operation| match &operation.edit {
        Edit::Add(path) => Some(scene::file_of(path)),
        _ => None,
    });
    let scene = scene::file_of(&args.scene);
    let inputs: Vec<PathBuf> = others.chain([scene.clone()]).collect();
    output_folder::check_file(&args.to, &inputs)?;
    let is_local = args.operations.iter().all(|operation| operation.edit.is_local());
    let is_local = is_local && args.views.is_none() && writes_parts_3d(&args.to);
    let report = match is_local.then(|| Parts3d::open(&scene)).transpose()?.flatten() {
        Some(parts) => in_parts(args, parts)?,
        None => as_a_whole(args, inputs)?,
    };
    output::answer(args.json, &report, || text(&report))
}

/// What was done to a scene, or to its parts so far.
#[derive(Debug, Default)]
struct Work {
    from: usize,
    gaussians: usize,
    /// What each operation did.
    done: Vec<Done>,
    trained_with: TrainedWith,
    losses: Vec<ConversionLoss>,
}

impl Work {
    /// Edits a scene or its next part.
    fn edit(
        &mut self,
        args: &EditArgs,
        file: &mut File3d,
        mut apply: impl FnMut(&Operation, &mut File3d) -> Result<Done, Failure>,
    ) -> Result<(), Failure> {
        self.from += file.scene.len();
        for (index, operation) in args.operations.iter().enumerate() {
            if let Edit::Add(path) = &operation.edit {
                let path = scene::file_of(path);
                if path.is_file() {
                    memory::check_3d(&path)?;
                }
            }
            let done = apply(operation, file)?;
            match self.done.get_mut(index) {
                Some(before) => *before = before.clone().and(done),
                None => self.done.push(done),
            }
        }
        self.gaussians += file.scene.len();
        self.trained_with = file.trained_with;
        ConversionLoss::merge(&mut self.losses, file.losses.drain(..));
        Ok(())
    }

    fn report(mut self, args: &EditArgs, written: Written3d) -> Report {
        ConversionLoss::merge(&mut self.losses, written.losses);
        let path = |path: &Path| path.display().to_string();
        let texts = args.operations.iter().zip(&self.done);
        Report {
            read: path(&scene::file_of(&args.scene)),
            written: path(&args.to),
            format: written.format.to_string(),
            from: self.from,
            gaussians: self.gaussians,
            operations: texts.map(|(operation, done)| format!("{}: {done}", operation.text)).collect(),
            frame: Some(self.trained_with.frame).filter(|frame| !frame.is_world()),
            lost: self.losses.iter().map(ConversionLoss::to_string).collect(),
        }
    }
}

/// An operation on a scene without views, or on a part of one.
fn applied(operation: &Operation, file: &mut File3d) -> Result<Done, Failure> {
    let done = operation.edit.apply(&mut file.scene, &mut file.trained_with.frame);
    done.map_err(|error| operation.failed(error))
}

/// Edits part by part, twice: the number of Gaussians stands before the first.
fn in_parts(args: &EditArgs, parts: Parts3d) -> Result<Report, Failure> {
    let mut work = Work::default();
    for part in parts {
        work.edit(args, &mut part.map_err(Failure::of_scene)?, applied)?;
    }
    for (operation, done) in args.operations.iter().zip(&work.done) {
        done.clone().check().map_err(|error| operation.failed(error))?;
    }
    let options = WriteOptions3d::default().with(|s| s.trained_with = work.trained_with);
    let again = Parts3d::open(scene::file_of(&args.scene))?.into_iter().flatten().map(|part| {
        let mut part = part.map_err(Failure::of_scene)?;
        Work::default().edit(args, &mut part, applied)?;
        Ok::<_, Failure>(part.scene)
    });
    let written = gs_io::write_parts_3d(&args.to, work.gaussians, &options, again)?;
    Ok(work.report(args, written))
}

/// Edits a scene in memory.
fn as_a_whole(args: &EditArgs, mut inputs: Vec<PathBuf>) -> Result<Report, Failure> {
    let mut file = scene::read_3d(&args.scene)?;
    output_folder::check_file(&args.to, &file.beside)?;
    inputs.extend(file.beside.iter().cloned());
    let mut work = Work::default();
    let checked = |operation: &Operation, done: Result<Done, gs_train::Error>| {
        let done = done.and_then(|done| Ok(done.check()?));
        done.map_err(|error| operation.failed(error))
    };
    match &args.views {
        None => work.edit(args, &mut file, |operation, file| {
            applied(operation, file)?.check().map_err(|error| operation.failed(error))
        })?,
        Some(path) => {
            let dataset = args.images.read_for(&file, path)?;
            let render = args.render.settings(&file, Some(&dataset));
            args.render.note_guess(&file);
            let backend = args.backend.open()?;
            let mut editor = ViewEditor::new(backend.rasterizer.for_3d(), Views::of_dataset(&dataset).cached(), render);
            editor.pictures = if args.preview.is_some() { PICTURES } else { 0 };
            work.edit(args, &mut file, |operation, file| {
                let done = editor.apply(&operation.edit, &mut file.scene, &mut file.trained_with.frame).block_on();
                checked(operation, done)
            })?;
            if let Some(folder) = &args.preview {
                write_pictures(folder, &editor.marked)?;
            }
        }
    }
    let options = WriteOptions3d::default().with(|s| s.trained_with = file.trained_with);
    let beside = Format3d::to_write(&args.to).map(|format| format.beside(&args.to, file.scene.sh_degree));
    beside.iter().flatten().try_for_each(|path| output_folder::check_file(path, &inputs))?;
    let written = gs_io::write_3d(&args.to, &file.scene, &options).map_err(Failure::of_scene)?;
    Ok(work.report(args, written))
}

/// Writes what the operations would remove, in a signal colour.
fn write_pictures(folder: &Path, marked: &[(String, Image)]) -> Result<(), Failure> {
    gs_io::prepare_folder(folder)?;
    for (name, image) in marked {
        gs_io::write_png(folder.join(format!("{name}.png")), image)?;
    }
    Ok(())
}

fn text(report: &Report) -> String {
    let mut text = format!("read        {}: {}", report.read, counted(report.from, "Gaussian"));
    report.operations.iter().for_each(|done| _ = write!(text, "\ndone        {done}"));
    let gaussians = counted(report.gaussians, "Gaussian");
    let _ = write!(text, "\nwrote       {}: {}, {gaussians}", report.written, report.format);
    report.lost.iter().for_each(|loss| _ = write!(text, "\nlost        {loss}"));
    text
}
