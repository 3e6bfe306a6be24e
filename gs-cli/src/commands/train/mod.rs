//! `gs train`: posed images become a 3D scene.
//!
//! Data set, flags and folder are checked before the output folder is changed, and that before the
//! first step.

mod arguments;
mod pictures;
mod results;
mod settings;
mod time_limit;

use std::path::{Path, PathBuf};

use gs_backend::{AnyRasterizer, Chosen, FutureExt as _};
use gs_core::{Scene3d, counted, memory::amount};
use gs_io::{
    Checkpoint,
    dataset::{AlphaMeaning, Dataset, Remark, Split},
    read_checkpoint,
};
use gs_poses::is_video;
use gs_train::{
    MetricsLog, TrainSettings, Trainer3d,
    train::{RefinePoses, Start, TrialReport, Views},
};

pub(crate) use self::{
    arguments::{TrainArgs, TrainSettingsArgs},
    settings::settings,
};
use self::{results::Results, time_limit::TimeLimit};
use crate::{
    commands::poses,
    failure::Failure,
    files::output_folder,
    flags::dataset::{DatasetArgs, remark_text},
    memory::Need,
    terminal::output::{self, printable, quoted},
    training::{self, Pauses, job::Job, phases::Phases},
};

/// Number of steps from which a training stores checkpoints by default.
const LONG: u32 = 2_000;

/// Trains a scene from a data set and writes the results.
pub(crate) fn run(args: &TrainArgs) -> Result<(), Failure> {
    let phases = Phases::begin();
    let (resumed, output) = (args.resume.as_deref(), args.run.output.as_path());
    let mut inputs = args.files();
    output_folder::check(&args.run.claim(output, &inputs, resumed))?;
    let mut path = args.dataset.clone();
    let dataset = match args.images.read(&path) {
        Err(gs_io::Error::NotADataset { photographs, .. }) if photographs.is_some() || is_video(&path) => {
            path = poses::dataset_of(&path, output, args.run.backend.threads)?;
            args.images.read(&path)
        }
        read => read,
    }?;
    let path = path.as_path();
    pictures::keep_off(&dataset, output)?;
    inputs.extend(dataset.files());
    let limit = args.settings.minutes.map(|minutes| TimeLimit::new(phases.started(), minutes, &args.settings));
    phases.end("dataset");
    let job = Job { phases, ..args.run.job(output, &inputs, resumed)? };
    let start = match resumed {
        Some(file) => TrainStart::Resumed(Box::new(read_checkpoint(file)?), file.to_owned()),
        None => {
            let mut settings = settings::settings(&args.settings, &dataset)?;
            let (initial, description) = settings::initial(&args.settings, &dataset, &mut settings)?;
            settings.render = job.effects.for_training(&settings.render);
            TrainStart::Fresh { settings: Box::new(settings), initial, description }
        }
    };
    let backend = args.run.backend.open()?;
    job.phases.end("backend");
    output::note(&backend.reason);
    dataset.remarks.iter().for_each(|remark| output::note(format_args!("note: {}", remark_text(remark))));
    let names_gaussians = args.settings.gaussians.is_some() || args.settings.exactly;
    let command = command(args);
    let views = Views::of_dataset(&dataset);
    let keep_bytes = args.image_memory(&views, backend.rasterizer.name() == "cpu");
    let views = Views { keep_bytes, cache_folder: Some(output.to_owned()), ..views }.cached();
    train(job, (Input { path, dataset: &dataset, names_gaussians }, views), (start, limit), &backend, command)
}

/// What a training reads.
#[derive(Clone, Copy)]
struct Input<'a> {
    /// The path of the data set as it was given.
    path: &'a Path,
    dataset: &'a Dataset,
    /// Whether the user named a number of Gaussians.
    names_gaussians: bool,
}

fn train(
    job: Job,
    (input, views): (Input<'_>, Views),
    (start, mut limit): (TrainStart, Option<TimeLimit<'_>>),
    backend: &Chosen,
    command: String,
) -> Result<(), Failure> {
    let (trainer, log, description) =
        start.begin(&backend.rasterizer, (input.dataset, views), limit.as_mut(), &job.phases)?;
    check_memory(input.path, &trainer)?;
    let iterations = trainer.settings().iterations;
    let every = (iterations >= LONG).then_some(iterations / 10);
    let (run, checkpoints) = job.begin(&trainer, every, command)?;
    announce(input, run.folder.path(), &description, &trainer);
    run.job.phases.end("start");
    let results = Results { run: &run, input, backend };
    let pauses = limit.as_ref().map(|limit| limit as &dyn Pauses<Scene3d>);
    training::run(&run, checkpoints, (trainer, log), pauses, |trainer, log, points| results.write(trainer, log, points))
}

/// What a search for points has found, in words; `None` where nothing was searched.
fn found(asked: &Start, initial: &Start) -> Option<String> {
    let places = match asked {
        Start::Images | Start::PointsAndImages(_) => "the images",
        Start::Depths(_) => "the depth maps",
        _ => return None,
    };
    let known = match asked {
        Start::PointsAndImages(points) | Start::Depths(points) => points.len(),
        _ => 0,
    };
    Some(match initial {
        Start::Points(points) if known > 0 => {
            let found = points.len().saturating_sub(known);
            format!("{} of the data set and {found} found in {places}", counted(known, "point"))
        }
        Start::Points(points) => format!("{} found in {places}", counted(points.len(), "point")),
        _ => format!("random points, because too few were found in {places}"),
    })
}

/// Where a training begins.
enum TrainStart {
    Fresh {
        settings: Box<TrainSettings>,
        initial: Start,
        /// The initial Gaussians in words.
        description: String,
    },
    /// A checkpoint and its file.
    Resumed(Box<Checkpoint>, PathBuf),
}

impl TrainStart {
    /// The trainer at the start, its log so far, and the start in words.
    fn begin<'r>(
        self,
        rasterizer: &'r AnyRasterizer,
        (dataset, views): (&Dataset, Views),
        limit: Option<&mut TimeLimit<'_>>,
        phases: &Phases,
    ) -> Result<(Trainer3d<'r, AnyRasterizer>, MetricsLog, String), Failure> {
        match self {
            Self::Fresh { settings, initial, description } => {
                let asked = initial.clone();
                if matches!(asked, Start::Images | Start::PointsAndImages(_)) {
                    output::note("searching the images for points");
                }
                let initial = initial.searched(&views.train)?;
                let description = found(&asked, &initial).unwrap_or(description);
                phases.end("points");
                let (settings, log) = match limit {
                    Some(limit) => {
                        let (settings, log) = limit.choose(rasterizer, (dataset, &views), &initial, &settings)?;
                        phases.end("trial");
                        (settings, Some(log))
                    }
                    None => (*settings, None),
                };
                match settings.refine_poses {
                    _ if settings.iterations < RefinePoses::least_steps(views.train.len()) => {}
                    RefinePoses::On => output::note("moving the cameras on small images first"),
                    RefinePoses::Auto => output::note("testing the camera poses on small images first"),
                    _ => {}
                }
                let may_lengthen = settings.lengthen_to > settings.iterations;
                if settings.has_trial(views.train.len()) {
                    output::note("trying on small images first whether a longer run gains, and more Gaussians harm");
                }
                let trainer = Trainer3d::from_views(rasterizer, views, initial, settings);
                let trainer = trainer.block_on().map_err(|error| not_begun(error, &dataset.root))?;
                if may_lengthen {
                    output::note(trial_line(&trainer));
                    phases.end("trial");
                }
                let log = log.unwrap_or_else(|| MetricsLog::for_steps(trainer.iterations()));
                Ok((trainer, log, description))
            }
            Self::Resumed(checkpoint, file) => {
                let failed = |error| not_resumed(error, &file, dataset);
                let metadata = checkpoint.metadata.clone();
                let trainer = Trainer3d::resume_views(rasterizer, views, *checkpoint).map_err(failed)?;
                let log = MetricsLog::for_steps(trainer.settings().iterations).resumed(&metadata).map_err(failed)?;
                let description = format!("step {} of {}", trainer.step(), file.display());
                Ok((trainer, log, description))
            }
        }
    }
}

/// What a trial has decided, in words, or why there was none.
fn trial_line(trainer: &Trainer3d<'_, AnyRasterizer>) -> String {
    let steps = counted(trainer.iterations(), "step");
    let Some(&TrialReport { left_out, seconds, gain_db, gaussians, .. }) = trainer.trial() else {
        let views = counted(trainer.views().train.len(), "training view");
        return format!("{steps}: with {views}, a trial cannot tell whether more would gain");
    };
    let before = trainer.settings_to_repeat();
    let longer = trainer.iterations() > before.iterations;
    let (only, left_out) = (if longer { "" } else { "only " }, counted(left_out, "view"));
    let most = gaussians.map(|most| (format!("at most {}", counted(most, "Gaussian")), most > before.gaussians));
    let (more, fewer) = match most {
        Some((most, true)) => (format!(" and {most}"), String::new()),
        Some((most, false)) => (String::new(), format!("; {most}, because more of them harm these views")),
        None => Default::default(),
    };
    format!(
        "after a trial of {seconds:.1} s, {steps}{more}, because {left_out} that it left out gained {only}{gain_db:.2} \
         dB in its last third{fewer}"
    )
}

/// Fails where there is not enough memory for the views and the initial Gaussians. Prints a note if
/// there is not enough for the most Gaussians: they need not become so many.
fn check_memory(dataset: &Path, trainer: &Trainer3d<'_, AnyRasterizer>) -> Result<(), Failure> {
    let (views, settings) = (trainer.views(), trainer.settings());
    let sizes = || views.train_cameras().map(|camera| (camera.width, camera.height));
    let need = |gaussians: u32| Need {
        what: format!("training on {} with {gaussians} Gaussians", dataset.display()),
        bytes: settings.peak_bytes(sizes(), views.keep_bytes, gaussians.into()),
        held: 0,
        less: "scale down the images with --max-size, take fewer views, or fewer --gaussians",
    };
    need(trainer.count()).check_and_print()?;
    if let Err(failure) = need(settings.gaussians).check() {
        output::note(format_args!("note: {}", failure.message()));
    }
    Ok(())
}

/// Why a training cannot begin.
fn not_begun(error: gs_train::Error, dataset: &Path) -> Failure {
    let in_dataset = matches!(error, gs_train::Error::NothingInView { .. });
    let failure = Failure::from(error);
    if in_dataset { failure.at(dataset.display()).hint("--start random does so") } else { failure }
}

/// Why a checkpoint cannot be resumed.
fn not_resumed(error: gs_train::Error, file: &Path, dataset: &Dataset) -> Failure {
    let wrong_views = matches!(error, gs_train::Error::WrongTarget { .. });
    let failure = Failure::from(error).at(file.display());
    if !wrong_views {
        return failure;
    }
    let failure = failure.hint("give the same data set, masks, --holdout, --images, --alpha and --max-size");
    match dataset.remarks.iter().any(|remark| matches!(remark, Remark::Reduced { .. })) {
        true => failure.hint("--max-size none if the training used the images at full size"),
        false => failure,
    }
}

fn announce(
    Input { path, dataset, .. }: Input<'_>,
    folder: &Path,
    start: &str,
    trainer: &Trainer3d<'_, AnyRasterizer>,
) {
    let settings = trainer.settings();
    let held: Vec<&str> = dataset.views_of(Split::Test).map(|view| view.name.as_str()).collect();
    let names = match *held {
        [] => String::new(),
        [one] => format!(": {}", printable(one)),
        [first, last] => format!(": {} and {}", printable(first), printable(last)),
        [first, .., last] => format!(": {}, ..., {}", printable(first), printable(last)),
    };
    output::note(format_args!(
        "training on {} of {} of {} ({}; {} held out{names}) from {start}, with at most {} in {}, into {}",
        trainer.views().train.len(),
        counted(dataset.views.len(), "view"),
        path.display(),
        dataset.kind.name(),
        held.len(),
        counted(settings.gaussians, "Gaussian"),
        counted(settings.iterations - trainer.step(), "step"),
        folder.display()
    ));
    let (bytes, most) = (trainer.views().cached_bytes(), trainer.views().keep_bytes);
    if bytes > most {
        let (bytes, most) = (amount(bytes), amount(most));
        output::note(format_args!(
            "the images take {bytes}: {most} of memory (--image-memory), and a file in the output folder until the end"
        ));
    }
}

/// The command that resumes the training, without its flag `--resume`.
fn command(args: &TrainArgs) -> String {
    let (dataset, output) = (args.dataset.as_path(), args.run.output.as_path());
    let DatasetArgs { holdout, images, alpha, reading } = &args.images;
    let holdout = holdout.map_or_else(String::new, |holdout| format!(" --holdout {holdout}"));
    let images = images.as_ref().map_or_else(String::new, |images| format!(" --images {}", quoted(Path::new(images))));
    let alpha = if *alpha == AlphaMeaning::Mask { " --alpha mask" } else { "" };
    let memory = args.image_memory.map_or_else(String::new, |bytes| format!(" --image-memory {bytes}"));
    let (dataset, output, reading) = (quoted(dataset), quoted(output), reading.flags());
    format!("gs train {dataset}{holdout}{images}{alpha}{reading}{memory} -o {output}")
}
