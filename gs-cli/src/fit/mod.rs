//! `gs fit`: an image becomes Gaussians.
//!
//! Whatever can be refused is refused before the output folder is touched, and the folder before the first step is made.

pub(crate) mod arguments;
mod folder;
mod observers;
pub(crate) mod progress;
mod results;
mod settings;
mod target;
mod terminal;

use std::{
    path::{Path, PathBuf},
    time::Instant,
};

use gs_core::{PlanarScene, Rasterizer};
use gs_io::{Checkpoint, read_checkpoint};
use gs_train::{FitSettings, MetricsLog, Observer, Outcome, Trainer};

use crate::{
    backend::{Backend, Task},
    failure::Failure,
    fit::{
        arguments::{CheckpointArgs, FitArgs},
        folder::OutputFolder,
        observers::{Checkpoints, Curve, StopOnInterrupt},
        progress::Display,
        results::Results,
        target::Target,
    },
    interrupt::Interrupt,
    output::{self, Format},
};

/// Fits Gaussians to an image and writes the results.
///
/// # Errors
/// Where input, flags or the output folder are not possible, where the fit diverges, or where Ctrl-C stopped it.
pub(crate) fn run(args: &FitArgs) -> Result<(), Failure> {
    let started = Instant::now();
    let checkpoint = checkpoint_file(&args.checkpoints, &args.output);
    if checkpoint.is_dir() {
        let mend = "name a file with --checkpoint";
        return Err(Failure::usage("is a folder, not a file for checkpoints").at(checkpoint.display()).mend(mend));
    }
    let target = Target::load(args.image.as_deref(), settings::background(&args.settings)?)?;
    let start = match &args.checkpoints.resume {
        Some(file) => Start::Resumed(Box::new(read_checkpoint(file)?), file.clone()),
        None => Start::Fresh(Box::new(settings::resolve(&args.settings, &target)?)),
    };
    let backend = Backend::start(&args.backend)?;
    backend.run(Fit { args, target: &target, start, backend: &backend, started })
}

/// Where a fit begins.
enum Start {
    Fresh(Box<FitSettings>),
    /// A checkpoint, and the file it is from.
    Resumed(Box<Checkpoint>, PathBuf),
}

impl Start {
    /// The fit where it begins, and its log up to there.
    fn begin<'r, R: Rasterizer<PlanarScene>>(
        self,
        rasterizer: &'r R,
        target: &Target,
    ) -> Result<(Trainer<'r, R>, MetricsLog), Failure> {
        match self {
            Self::Fresh(settings) => {
                let log = MetricsLog::for_settings(&settings);
                Ok((Trainer::new(rasterizer, &target.image, *settings)?, log))
            }
            Self::Resumed(checkpoint, file) => {
                let failed = |error| not_resumed(error, &file);
                let metadata = checkpoint.metadata.clone();
                let trainer = Trainer::resume(rasterizer, &target.image, *checkpoint).map_err(failed)?;
                let log = MetricsLog::for_settings(trainer.settings()).resumed(&metadata).map_err(failed)?;
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
    started: Instant,
}

impl Task for Fit<'_> {
    type Output = Result<(), Failure>;

    fn run<R: Rasterizer<PlanarScene>>(self, rasterizer: &R) -> Result<(), Failure> {
        let Self { args, target, start, backend, started } = self;
        let (mut trainer, mut log) = start.begin(rasterizer, target)?;
        let folder = OutputFolder::prepare(&args.output, "--output")?;
        let mut checkpoints = checkpoints(args, &folder, trainer.settings().iterations)?;
        announce(args, target, backend, &trainer);

        let mut display = Display::new(trainer.step(), trainer.settings().iterations, args.detail());
        let voice = display.voice();
        let interrupt = Interrupt::listen(voice.clone());
        let mut curve = Curve::begun_by(&log);
        let stop = StopOnInterrupt(&interrupt);
        let outcome = trainer.run(&mut ((&mut display, &mut log), (&mut curve, (&mut checkpoints, stop))));
        voice.clear();
        let outcome = outcome?;
        if outcome == Outcome::Stopped {
            let mut checkpoint = trainer.checkpoint()?;
            log.on_checkpoint(&mut checkpoint)?;
            checkpoints.on_checkpoint(&mut checkpoint)?;
        }

        let results = Results { folder: &folder, target, backend, pictures: args.pictures(), started };
        let summary = results.write(rasterizer, &trainer, &log.to_csv(), &curve.0)?;
        match args.format() {
            Format::Json => output::json(&summary)?,
            Format::Text => output::note(summary.text(folder.path())),
        }
        match outcome {
            Outcome::Finished => Ok(()),
            Outcome::Stopped => Err(stopped(args, target, &checkpoints, trainer.step())),
        }
    }
}

/// The file for checkpoints, by default one among the results.
fn checkpoint_file(args: &CheckpointArgs, output: &Path) -> PathBuf {
    args.checkpoint.clone().unwrap_or_else(|| output.join("checkpoint.safetensors"))
}

/// Another image than the checkpoint's can be mended by the caller; what else is wrong says so itself.
fn not_resumed(error: gs_train::Error, file: &Path) -> Failure {
    let wrong_target = matches!(error, gs_train::Error::WrongTarget { .. });
    let failure = Failure::from(error).at(file.display());
    if wrong_target { failure.mend("give the same image and --background") } else { failure }
}

/// Where checkpoints go and how often, in a folder that is known to take them.
fn checkpoints(args: &FitArgs, folder: &OutputFolder, iterations: u32) -> Result<Checkpoints, Failure> {
    let CheckpointArgs { checkpoint, checkpoint_every, .. } = &args.checkpoints;
    let file = checkpoint_file(&args.checkpoints, folder.path());
    if let Some(parent) = file.parent().filter(|parent| !parent.as_os_str().is_empty()) {
        OutputFolder::prepare(parent, "--checkpoint")?;
    }
    let tenth = checkpoint.as_ref().map(|_| (iterations / 10).max(1));
    Ok(Checkpoints { file, every: checkpoint_every.or(tenth) })
}

fn announce<R: Rasterizer<PlanarScene>>(args: &FitArgs, target: &Target, backend: &Backend, trainer: &Trainer<'_, R>) {
    output::note(&backend.reason);
    if let Some(remark) = &target.remark {
        output::note(remark);
    }
    let settings = trainer.settings();
    output::note(format_args!(
        "fitting {} ({}x{} px) with at most {} Gaussians in {} steps, into {}",
        target.name(),
        target.image.width(),
        target.image.height(),
        settings.gaussians,
        settings.iterations - trainer.step(),
        args.output.display()
    ));
}

fn stopped(args: &FitArgs, target: &Target, checkpoints: &Checkpoints, step: u32) -> Failure {
    let image = target.file.as_ref().map_or_else(String::new, |file| format!(" {}", quoted(file)));
    let backdrop = target.behind.map_or_else(String::new, |color| format!(" --background {color}"));
    Failure::interrupted(format_args!(
        "stopped after step {step}; to go on: gs fit{image}{backdrop} -o {} --resume {}",
        quoted(&args.output),
        quoted(&checkpoints.file)
    ))
}

/// The path as one word of a shell's command line.
fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    let plain = |character: char| character.is_alphanumeric() || "/\\:._-+=@%,".contains(character);
    match text.chars().all(plain) {
        true => text,
        false => format!("'{}'", text.replace('\'', r"'\''")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
