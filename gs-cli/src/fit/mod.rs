//! `gs fit`: an image becomes Gaussians.
//!
//! Whatever can be refused is refused before the output folder is touched, and the folder before the first step is made.

pub(crate) mod arguments;
pub(crate) mod checkpoints;
pub(crate) mod observers;
pub(crate) mod progress;
pub(crate) mod results;
pub(crate) mod settings;
pub(crate) mod status;
pub(crate) mod target;
pub(crate) mod terminal;
pub(crate) mod trouble;

use pollster::FutureExt as _;
use std::{
    path::{Path, PathBuf},
    time::Instant,
};

use gs_core::{Optimizer, RenderSettings, Scene2d, counted};
use gs_io::{Checkpoint, FolderClaim, read_checkpoint};
use gs_train::{FitSettings, MetricsLog, Observer, Outcome, Trainable, Trainer};

use crate::{
    backend::{Backend, Task},
    failure::Failure,
    fit::{
        arguments::FitArgs,
        checkpoints::{Checkpoints, Storing, check_checkpoint_file},
        observers::{Curve, LogFile, StopOnInterrupt},
        progress::Display,
        results::Results,
        settings::Given,
        target::Target,
    },
    interrupt::Interrupt,
    memory::{self, Need},
    output::{self, Format},
    output_folder::{self, OutputFolder},
    training_arguments::Detail,
};

/// Fits Gaussians to an image and writes the results.
///
/// # Errors
/// Where input, flags or the output folder are not possible, where the fit diverges or loses its GPU, or where Ctrl-C stopped it.
pub(crate) fn run(args: &FitArgs) -> Result<(), Failure> {
    let started = Instant::now();
    check_checkpoint_file(
        &args.checkpoints,
        [&args.image, &args.settings.settings].into_iter().flatten(),
        args.overwrite,
        &args.claim(),
    )?;
    let claim = args.claim();
    output_folder::check(&claim)?;
    let given = Given::read(&args.settings)?;
    args.image.as_deref().map_or(Ok(()), memory::check_image)?;
    let target = Target::load(args.image.as_deref(), given.background(&args.settings))?;
    let start = match &args.resume {
        Some(file) => Start::Resumed(Box::new(read_checkpoint(file)?), file.clone()),
        None => {
            let mut settings = settings::resolve(&args.settings, &given, &target)?;
            settings.render = args.effects.before(&settings.render);
            Start::Fresh(Box::new(settings))
        }
    };
    let backend = Backend::start_for_image(&args.backend.or_chosen(given.machine()), &start.render())?;
    backend.run(Fit { args, target: &target, start, backend: &backend, claim, started })
}

/// Where a fit begins.
enum Start {
    Fresh(Box<FitSettings>),
    /// A checkpoint, and the file it is from.
    Resumed(Box<Checkpoint>, PathBuf),
}

impl Start {
    /// How the fit is shown while it goes on; the usual where a checkpoint does not say, which is its reader's to tell.
    fn render(&self) -> RenderSettings {
        match self {
            Self::Fresh(settings) => settings.render,
            Self::Resumed(checkpoint, _) => {
                let text = checkpoint.metadata.get("settings").map_or("", String::as_str);
                gs_train::parse_settings::<FitSettings>(text, Path::new("checkpoint"))
                    .map_or_else(|_| RenderSettings::default(), |settings| settings.render)
            }
        }
    }

    /// The fit where it begins, and its log up to there.
    fn begin<'r, R: Optimizer<Scene2d>>(
        self,
        rasterizer: &'r R,
        target: &Target,
    ) -> Result<(Trainer<'r, R>, MetricsLog), Failure> {
        match self {
            Self::Fresh(settings) => {
                check_memory(target, &settings)?;
                let log = MetricsLog::for_steps(settings.iterations);
                Ok((Trainer::new(rasterizer, &target.image, *settings).block_on()?, log))
            }
            Self::Resumed(checkpoint, file) => {
                let failed = |error| not_resumed(error, &file);
                let metadata = checkpoint.metadata.clone();
                let trainer = Trainer::resume(rasterizer, &target.image, *checkpoint).map_err(failed)?;
                check_memory(target, trainer.settings())?;
                let log = MetricsLog::for_steps(trainer.iterations()).resumed(&metadata).map_err(failed)?;
                Ok((trainer, log))
            }
        }
    }
}

struct Fit<'a> {
    args: &'a FitArgs,
    target: &'a Target,
    start: Start,
    backend: &'a Backend,
    claim: FolderClaim,
    started: Instant,
}

impl Task for Fit<'_> {
    type Output = Result<(), Failure>;

    fn run<R: Optimizer<Scene2d>>(self, rasterizer: &R) -> Result<(), Failure> {
        let Self { args, target, start, backend, claim, started } = self;
        let (mut trainer, mut log) = start.begin(rasterizer, target)?;
        let folder = OutputFolder::begin(claim)?;
        let (iterations, resumed) = (trainer.settings().iterations, args.resume.as_deref());
        let mut checkpoints = Checkpoints::prepare(&args.checkpoints, &folder, iterations, None, resumed)?;
        announce(args, target, backend, &trainer);

        let (effects, pictures) = (&args.effects, args.pictures());
        let seconds_before = args.resume.as_ref().map_or(0.0, |_| trainer.seconds());
        let results = Results { folder: &folder, target, backend, effects, pictures, started, seconds_before };
        let ended = follow(args.detail(), &mut trainer, &mut log, &folder, &mut checkpoints);
        let ended = ended.and_then(|(outcome, curve)| {
            let summary = results.write(rasterizer, &trainer, &log, &curve.0)?;
            Ok((outcome, summary))
        });
        let resuming = |file: &Path| resuming(args, target, file);
        let (outcome, summary) = ended.map_err(|failure| checkpoints.with_way_on(failure, resuming))?;
        checkpoints.remove_unasked(outcome, &args.checkpoints);
        match args.format() {
            Format::Json => output::json(&summary)?,
            Format::Text => output::note(summary.text(folder.path(), args.detail())),
        }
        checkpoints.conclude(outcome, trainer.step(), &args.checkpoints, resuming)
    }
}

/// Steps to the end, or to where Ctrl-C lets it be resumed, before the eyes of the observers; the curve is what they saw.
pub(crate) fn follow<R: Optimizer<S>, S: Trainable>(
    detail: Detail,
    trainer: &mut Trainer<'_, R, S>,
    log: &mut MetricsLog,
    folder: &OutputFolder,
    checkpoints: &mut Checkpoints,
) -> Result<(Outcome, Curve), Failure> {
    let mut display = Display::new(trainer.step(), trainer.iterations(), detail);
    let voice = display.voice();
    let interrupt = Interrupt::listen(voice.clone());
    let mut curve = Curve::begun_by(log);
    let stop = StopOnInterrupt(&interrupt);
    let mut file = LogFile::begin(folder, log, voice.clone())?;
    let storing = Storing::new(checkpoints, voice.clone());
    let outcome = trainer.run(&mut ((&mut display, &mut file), (&mut curve, (storing, stop)))).block_on();
    voice.clear();
    let outcome = outcome?;
    if outcome == Outcome::Stopped {
        // Results come next, whatever becomes of it.
        let taken = trainer.checkpoint().block_on().and_then(|mut checkpoint| {
            log.on_checkpoint(&mut checkpoint)?;
            Ok(checkpoint)
        });
        match taken {
            Ok(checkpoint) => checkpoints.store(&checkpoint),
            Err(error) => checkpoints.failure = Some(error.into()),
        }
    }
    Ok((outcome, curve))
}

/// Fails where there is not the memory for a fit to this image.
fn check_memory(target: &Target, settings: &FitSettings) -> Result<(), Failure> {
    let (width, height) = target.image.size();
    let (bytes, held) = (settings.peak_bytes((width, height)), size_of_val(target.image.pixels()) as u64);
    let what = format!("fitting {} Gaussians to {} ({width}x{height} px)", settings.gaussians, target.name());
    Need { what, bytes, held, less: "take a smaller image or fewer Gaussians" }.check_aloud()
}

/// Another image than the checkpoint's can be mended by the caller; what else is wrong says so itself.
fn not_resumed(error: gs_train::Error, file: &Path) -> Failure {
    let wrong_target = matches!(error, gs_train::Error::WrongTarget { .. });
    let failure = Failure::from(error).at(file.display());
    if wrong_target { failure.mend("give the same image and --background") } else { failure }
}

fn announce<R: Optimizer<Scene2d>>(args: &FitArgs, target: &Target, backend: &Backend, trainer: &Trainer<'_, R>) {
    output::note(&backend.reason);
    target.remarks.iter().for_each(output::note);
    let settings = trainer.settings();
    output::note(format_args!(
        "fitting {} ({}x{} px) with at most {} in {}, into {}",
        target.name(),
        target.image.width(),
        target.image.height(),
        counted(settings.gaussians, "Gaussian"),
        counted(settings.iterations - trainer.step(), "step"),
        args.output.display()
    ));
}

/// The command that goes on from a checkpoint.
fn resuming(args: &FitArgs, target: &Target, checkpoint: &Path) -> String {
    let image = target.file.as_ref().map_or_else(String::new, |file| format!(" {}", quoted(file)));
    let background = target.behind.map_or_else(String::new, |color| format!(" --background {color}"));
    format!("gs fit{image}{background} -o {} --resume {}", quoted(&args.output), quoted(checkpoint))
}

/// The path as one word of a shell's command line.
pub(crate) fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    let plain = |character: char| character.is_alphanumeric() || "/\\:._-+=@%,".contains(character);
    match text.chars().all(plain) {
        true => text,
        false => format!("'{}'", text.replace('\'', r"'\''")),
    }
}

#[cfg(test)]
mod tests {
    use std::{process::ExitCode, thread, time::Duration};

    use clap::Parser;
    use gs_wgpu::{WgpuRasterizer, WgpuSettings};

    use super::*;
    use crate::backend::{BackendArgs, Choice};

    #[derive(Debug, Parser)]
    struct Flags {
        #[command(flatten)]
        fit: FitArgs,
    }

    fn flags(words: &[&str]) -> FitArgs {
        Flags::try_parse_from(["fit"].iter().chain(words)).unwrap().fit
    }

    #[test]
    fn a_lost_gpu_ends_the_fit_with_one_line_that_says_how_to_go_on() {
        let place = tempfile::tempdir().unwrap();
        let (output, state) = (place.path().join("out"), place.path().join("state"));
        let (output_flag, state_flag) = (output.to_str().unwrap(), state.to_str().unwrap());
        let words = ["-o", output_flag, "-n", "30", "-i", "1000000", "--checkpoint", state_flag];
        let args = flags(&[&words[..], &["--checkpoint-every", "10"]].concat());
        let target = Target::load(None, None).unwrap();
        let start = Start::Fresh(Box::new(settings::resolve(&args.settings, &Given::Nothing, &target).unwrap()));
        let backend = Backend::start(&BackendArgs { backend: Choice::Cpu, ..BackendArgs::default() }).unwrap();
        let wgpu =
            WgpuRasterizer::new(WgpuSettings::default()).block_on().expect("`cargo xtask test` installs a driver");
        let failure = thread::scope(|scope| {
            scope.spawn(|| {
                while !state.exists() {
                    thread::sleep(Duration::from_millis(5));
                }
                wgpu.lose_device();
            });
            let (claim, started) = (args.claim(), Instant::now());
            let fit = Fit { args: &args, target: &target, start, backend: &backend, claim, started };
            fit.run(&wgpu).unwrap_err()
        });
        let line = failure.line().unwrap();
        assert!(line.starts_with("error: backend wgpu: ") && line.contains("the device was lost"), "{line}");
        assert!(line.ends_with(&format!(": gs fit -o {output_flag} --resume {state_flag}")), "{line}");
        assert_eq!(failure.status(), ExitCode::FAILURE);
        assert!(read_checkpoint(&state).is_ok());
        assert_eq!(place.path().read_dir().unwrap().count(), 2, "the folder and the checkpoint");
        let names = output.read_dir().unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let left: Vec<_> = names.filter(|name| !name.starts_with(".gs-")).collect();
        assert_eq!(left, ["metrics.part.csv"], "no results, and nothing half-written");
        let metrics = std::fs::read_to_string(output.join("metrics.part.csv")).unwrap();
        assert!(metrics.lines().nth(1).is_some_and(|row| row.starts_with("1,")), "{metrics}");
    }

    #[test]
    fn paths_are_single_words_of_a_command_line() {
        assert_eq!(quoted(Path::new("out/a-1.png")), "out/a-1.png");
        assert_eq!(quoted(Path::new("my pictures/it's.png")), r"'my pictures/it'\''s.png'");
    }

    #[test]
    fn only_another_image_is_mended_by_the_same_image() {
        let line = |error| not_resumed(error, Path::new("state")).line().unwrap();
        let (expected, found) = ("1x1".to_owned(), "2x2".to_owned());
        assert!(
            line(gs_train::Error::WrongTarget { expected, found }).ends_with(": give the same image and --background")
        );
        assert!(line(gs_train::Error::Checkpoint("no step".to_owned())).ends_with(": no step"));
    }
}
