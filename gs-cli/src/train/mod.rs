//! `gs train`: posed photographs become a 3D scene.
//!
//! Whatever can be refused is refused before the output folder is touched, and the folder before the first step is made.

mod arguments;
mod pictures;
mod results;
mod settings;

use pollster::FutureExt as _;
use std::{
    path::{Path, PathBuf},
    time::Instant,
};

use gs_core::{Optimizer, Parameterization, Scene3d, counted};
use gs_io::{
    Checkpoint, FolderClaim,
    dataset::{Dataset, Remark, Split, read_dataset},
    read_checkpoint,
};
use gs_train::{
    MetricsLog, TrainSettings, Trainer3d,
    train::{Start, Views},
};

pub(crate) use self::{
    arguments::{DatasetArgs, OrderName, TrainArgs},
    settings::usual_background,
};
use crate::{
    backend::{Backend, Task3d},
    dataset::remark_text,
    failure::Failure,
    fit::{
        checkpoints::{Checkpoints, check_checkpoint_file},
        follow, quoted,
    },
    memory::Need,
    output::{self, Format},
    output_folder::{self, OutputFolder},
    train::results::Results,
};

/// Steps from which on a training is too long to be lost: it stores checkpoints without being asked.
const LONG: u32 = 2_000;

/// Trains a scene from a data set and writes the results.
///
/// # Errors
/// Where data set, flags or output folder are not possible, where the training diverges or loses its GPU, or where Ctrl-C stopped it.
pub(crate) fn run(args: &TrainArgs) -> Result<(), Failure> {
    let started = Instant::now();
    output_folder::check(&args.claim([]))?;
    let dataset = read_dataset(&args.dataset, &args.photographs.settings())?;
    pictures::keep_off(&dataset, &args.output)?;
    let read = dataset.files();
    let inputs = args.files().chain(read.iter().cloned());
    check_checkpoint_file(&args.checkpoints, inputs, args.overwrite, &args.claim([]))?;
    let claim = args.claim(read);
    let begin = match &args.resume {
        Some(file) => Begin::Resumed(Box::new(read_checkpoint(file)?), file.clone()),
        None => {
            let mut settings = settings::resolve(&args.settings, &dataset)?;
            settings.render = args.effects.before(&settings.render);
            let (start, told) = settings::start(&args.settings, &dataset)?;
            Begin::Fresh { settings: Box::new(settings), start, told }
        }
    };
    let backend = Backend::start_in_space(&args.backend, begin.parameterization())?;
    backend.run_3d(Train { args, dataset: &dataset, begin, backend: &backend, claim, started })
}

/// Where a training begins.
enum Begin {
    Fresh {
        settings: Box<TrainSettings>,
        start: Start,
        /// The start in words.
        told: String,
    },
    /// A checkpoint, and the file it is from.
    Resumed(Box<Checkpoint>, PathBuf),
}

impl Begin {
    fn parameterization(&self) -> Parameterization {
        match self {
            Self::Fresh { settings, .. } => settings.parameterization,
            Self::Resumed(checkpoint, _) => checkpoint.state.parameterization,
        }
    }

    /// The training where it begins, its log up to there, and the beginning in words.
    fn begin<'r, R: Optimizer<Scene3d>>(
        self,
        rasterizer: &'r R,
        dataset: &Dataset,
    ) -> Result<(Trainer3d<'r, R>, MetricsLog, String), Failure> {
        let views = Views::of_dataset(dataset);
        match self {
            Self::Fresh { settings, start, told } => {
                let log = MetricsLog::for_steps(settings.iterations);
                let trainer = Trainer3d::from_views(rasterizer, views, start, *settings);
                Ok((trainer.block_on().map_err(|error| not_begun(error, &dataset.root))?, log, told))
            }
            Self::Resumed(checkpoint, file) => {
                let failed = |error| not_resumed(error, &file, dataset);
                let metadata = checkpoint.metadata.clone();
                let trainer = Trainer3d::resume_views(rasterizer, views, *checkpoint).map_err(failed)?;
                let log = MetricsLog::for_steps(trainer.settings().iterations).resumed(&metadata).map_err(failed)?;
                let told = format!("step {} of {}", trainer.step(), file.display());
                Ok((trainer, log, told))
            }
        }
    }
}

struct Train<'a> {
    args: &'a TrainArgs,
    dataset: &'a Dataset,
    begin: Begin,
    backend: &'a Backend,
    claim: FolderClaim,
    started: Instant,
}

impl Task3d for Train<'_> {
    type Output = Result<(), Failure>;

    fn run<R: Optimizer<Scene3d>>(self, rasterizer: &R) -> Result<(), Failure> {
        let Self { args, dataset, begin, backend, claim, started } = self;
        output::note(&backend.reason);
        dataset.remarks.iter().for_each(|remark| output::note(format_args!("note: {}", remark_text(remark))));
        let (mut trainer, mut log, told) = begin.begin(rasterizer, dataset)?;
        check_memory(args, &trainer)?;
        let folder = OutputFolder::begin(claim)?;
        let iterations = trainer.settings().iterations;
        let unasked = (iterations >= LONG).then_some(iterations / 10);
        let resumed = args.resume.as_deref();
        let mut checkpoints = Checkpoints::prepare(&args.checkpoints, &folder, iterations, unasked, resumed)?;
        announce(args, dataset, &told, &trainer);

        let seconds_before = args.resume.as_ref().map_or(0.0, |_| trainer.seconds());
        let results = Results { args, folder: &folder, backend, started, seconds_before };
        let ended = follow(args.detail(), &mut trainer, &mut log, &folder, &mut checkpoints);
        let ended = ended.and_then(|(outcome, curve)| {
            let summary = results.write(&trainer, &log, &curve.0)?;
            Ok((outcome, summary))
        });
        let resuming = |file: &Path| resuming(args, file);
        let (outcome, summary) = ended.map_err(|failure| checkpoints.with_way_on(failure, resuming))?;
        checkpoints.remove_unasked(outcome, &args.checkpoints);
        match args.format() {
            Format::Json => output::json(&summary)?,
            Format::Text => output::note(summary.text(folder.path(), args.detail())),
        }
        checkpoints.conclude(outcome, trainer.step(), &args.checkpoints, resuming)
    }
}

/// Fails where there is not the memory for the views and the Gaussians that there are; tells what all Gaussians that there may be take.
fn check_memory<R: Optimizer<Scene3d>>(args: &TrainArgs, trainer: &Trainer3d<'_, R>) -> Result<(), Failure> {
    let (views, settings) = (trainer.views(), trainer.settings());
    let sizes = || views.train_cameras().map(|camera| (camera.width, camera.height));
    let of = |gaussians: u32| Need {
        what: format!("training on {} with {gaussians} Gaussians", args.dataset.display()),
        bytes: settings.peak_bytes(sizes(), views.keep_bytes, gaussians.into()),
        held: 0,
        less: "take smaller or fewer views, or fewer --gaussians",
    };
    of(trainer.count()).check_aloud()?;
    // They need not become so many.
    if let Err(failure) = of(settings.gaussians).check() {
        output::note(format_args!("note: {}", failure.message()));
    }
    Ok(())
}

/// Poses and points that do not belong together are the data set's; what else is wrong says so itself.
fn not_begun(error: gs_train::Error, dataset: &Path) -> Failure {
    let in_dataset = matches!(error, gs_train::Error::NothingInView { .. });
    let failure = Failure::from(error);
    if in_dataset { failure.at(dataset.display()).mend("--start random begins there") } else { failure }
}

/// Another data set than the checkpoint's can be mended by the caller; what else is wrong says so itself.
fn not_resumed(error: gs_train::Error, file: &Path, dataset: &Dataset) -> Failure {
    let wrong_views = matches!(error, gs_train::Error::WrongTarget { .. });
    let failure = Failure::from(error).at(file.display());
    if !wrong_views {
        return failure;
    }
    let failure = failure.mend("give the same data set, masks, --holdout, --images, --alpha and --max-size");
    match dataset.remarks.iter().any(|remark| matches!(remark, Remark::Reduced { .. })) {
        true => failure.mend("--max-size none if the training saw its images at full size"),
        false => failure,
    }
}

fn announce<R: Optimizer<Scene3d>>(args: &TrainArgs, dataset: &Dataset, told: &str, trainer: &Trainer3d<'_, R>) {
    let settings = trainer.settings();
    output::note(format_args!(
        "training on {} of {} of {} ({}, {} held out) from {told}, with at most {} in {}, into {}",
        trainer.views().train.len(),
        counted(dataset.views.len(), "view"),
        args.dataset.display(),
        dataset.kind.name(),
        dataset.views_of(Split::Test).count(),
        counted(settings.gaussians, "Gaussian"),
        counted(settings.iterations - trainer.step(), "step"),
        args.output.display()
    ));
}

/// The command that goes on from a checkpoint.
fn resuming(args: &TrainArgs, checkpoint: &Path) -> String {
    let DatasetArgs { holdout, images, alpha, reading } = &args.photographs;
    let holdout = if *holdout == 8 { String::new() } else { format!(" --holdout {holdout}") };
    let images = images.as_ref().map_or_else(String::new, |images| format!(" --images {}", quoted(Path::new(images))));
    let alpha = if *alpha == arguments::AlphaName::Mask { " --alpha mask" } else { "" };
    let (dataset, output, reading) = (quoted(&args.dataset), quoted(&args.output), reading.flags());
    format!("gs train {dataset}{holdout}{images}{alpha}{reading} -o {output} --resume {}", quoted(checkpoint))
}
