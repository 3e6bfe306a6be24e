//! `gs poses`: photographs or a video become a data set, with camera poses that COLMAP finds.

use std::{
    path::{Path, PathBuf},
    time::Duration,
};

use clap::Args;
use gs_core::counted;
use gs_io::{Inputs, OutputFolder};
use gs_poses::{
    Colmap, Error, FILES, Input, LensKind, Pairs, PoseQuality, Reporter, Settings, Stage, Verdict, find_poses,
    refuse_other_models,
};

use crate::{
    failure::Failure,
    files::output_folder::{self, OverwriteArgs},
    flags::values::{by_name, whole},
    terminal::{
        interrupt::Interrupt,
        output::{self, quoted},
        stages::Stages,
    },
};

const AFTER_HELP: &str = "\
PHOTOS is a folder of photographs, also in subfolders. A mask for photo.jpg is masks/photo.jpg.png: \
black pixels are ignored. COLMAP 3.7 or later must be installed, \
or pycolmap 4.1.1 or later in python3 or in the Python that GS_PYTHON names. HEIC photographs are converted by \
heif-convert or ImageMagick.

PHOTOS can also be a video, which ffmpeg must be installed for: at most 300 of its frames become \
photographs, the sharpest wherever the picture has moved by a tenth of its longer side, or less in \
short videos.

DIR is then a data set for gs train:
  images/      the photographs: links where the file system has them, else copies; frames of a video, \
and converted photographs
  masks/       the masks, if there are any
  sparse/0/    cameras, poses and points in COLMAP's format; -y is up
  frames.json  the times of the frames of a video
  poses.json   the verdict
  poses.log    all that COLMAP said

Photographs share a camera by their EXIF data and size. All pairs of up to 150 photographs are \
compared, and neighbours of more: by time if all have one (EXIF), otherwise by name. Of several \
pieces, the one with most photographs is taken.

Ctrl-C stops; what is done is kept in DIR/.gs-poses, and --resume continues there.";

/// The flags of `gs poses`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct PosesArgs {
    /// The folder of photographs, or a video
    photos: PathBuf,
    /// Folder for the data set; made if necessary
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Find features in photographs whose longer side is scaled down to this many pixels
    #[arg(long, value_name = "PX", default_value_t = Settings::default().max_size, value_parser = whole::<u32>(100..))]
    max_size: u32,
    /// The kind of lens
    #[arg(long, value_parser = by_name::<LensKind>(), default_value_t)]
    lens: LensKind,
    /// Which pairs of photographs are compared
    #[arg(long, value_parser = by_name::<Pairs>(), default_value_t)]
    pairs: Pairs,
    /// A vocabulary tree of COLMAP: where neighbours are compared, also compare what looks alike
    #[arg(long, value_name = "FILE")]
    vocabulary: Option<PathBuf>,
    /// Number of threads [default: one for each core]
    #[arg(long, value_name = "T", value_parser = whole::<u32>(1..=1024))]
    threads: Option<u32>,
    /// Continue what an interrupted run with the same flags has done
    #[arg(long)]
    resume: bool,
    /// Print the verdict as JSON on standard output, and nothing else there
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    overwrite: OverwriteArgs,
}

/// Finds the poses of photographs.
pub(crate) fn run(args: &PosesArgs) -> Result<(), Failure> {
    let input = Input::find(&args.photos)?;
    let settings = Settings::default().with(|s| {
        s.max_size = args.max_size;
        s.lens = args.lens;
        s.pairs = args.pairs;
        s.vocabulary = args.vocabulary.clone();
        s.threads = args.threads;
    });
    let command = format!("gs poses {} -o {}", quoted(&args.photos), quoted(&args.output));
    let verdict = find(&input, &settings, (&args.output, args.overwrite, args.resume), &command)?;
    if args.json {
        return output::json(&verdict);
    }
    let output = quoted(&args.output);
    output::result(format_args!(
        "{verdict}\nthe data set is {output}: gs train {output} -o gs-out trains a scene of it"
    ))
}

/// Makes the data set `output/dataset` of photographs or a video without poses, unless an earlier run did.
pub(crate) fn dataset_of(path: &Path, output: &Path, threads: Option<u16>) -> Result<PathBuf, Failure> {
    let input = Input::find(path)?;
    let dataset = output.join("dataset");
    let what = match &input {
        Input::Folder(photographs) => {
            format!("holds {} without camera poses", counted(photographs.count(), "photograph"))
        }
        _ => "is a video without camera poses".to_owned(),
    };
    output::note(format_args!(
        "{} {what}: COLMAP finds them first, and the data set is kept in {}",
        path.display(),
        dataset.display()
    ));
    let settings = Settings::default().with(|s| s.threads = threads.map(u32::from));
    let command = format!("gs train {} -o {}", quoted(path), quoted(output));
    let verdict = find(&input, &settings, (&dataset, OverwriteArgs::default(), true), &command)?;
    output::note(&verdict);
    match verdict.quality {
        PoseQuality::Poor => Err(Failure::failed("too few poses were found to train a scene")
            .at(path.display())
            .hint(format_args!("gs train {} does so nevertheless", quoted(&dataset)))),
        _ => Ok(dataset),
    }
}

/// Finds poses, resuming what is there if that is asked for. `command` does it again.
fn find(
    input: &Input,
    settings: &Settings,
    (output, overwrite, resume): (&Path, OverwriteArgs, bool),
    command: &str,
) -> Result<Verdict, Failure> {
    let colmap = Colmap::find()?;
    let inputs: Inputs = input.paths().into_iter().collect();
    let claim = overwrite.claim(output, FILES, inputs);
    output_folder::check(&claim)?;
    refuse_other_models(output)?;
    let folder: OutputFolder = claim.begin()?;
    let stages = Stages::new(Duration::ZERO);
    let interrupt = Interrupt::listen(stages.printer(), "stopping");
    let mut display = Display { stages, interrupt };
    let found = find_poses(input, settings, &colmap, (&folder, resume), &mut display);
    display.stages.printer().clear_bar();
    found.map_err(|error| match error {
        error @ Error::Cancelled { .. } => {
            let flag = if command.starts_with("gs poses") { " --resume" } else { "" };
            Failure::interrupted(error).hint(format_args!("{command}{flag} continues"))
        }
        error => error.into(),
    })
}

/// What is shown, and Ctrl-C.
struct Display {
    stages: Stages,
    interrupt: Interrupt,
}

impl Reporter for Display {
    fn progress(&mut self, stage: Stage, done: usize, total: usize) {
        self.stages.show(stage.words(), stage.words(), done.min(total) as f64 / total.max(1) as f64);
    }

    fn note(&mut self, line: &str) {
        self.stages.printer().print(format_args!("note: {line}"));
    }

    fn is_cancelled(&self) -> bool {
        self.interrupt.requested()
    }
}
