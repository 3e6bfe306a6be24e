//! `gs fit`: an image becomes Gaussians.
//!
//! Input, flags and folder are checked before the output folder is changed, and that before the
//! first step.

mod arguments;
mod results;
mod several;

use std::path::{Path, PathBuf};

use gs_backend::{AnyRasterizer, Chosen, FutureExt as _};
use gs_core::{RenderSettings, counted};
use gs_io::{Checkpoint, read_checkpoint};
use gs_train::{FitSettings, MetricsLog, SettingsFile as _, Trainer};

pub(crate) use self::arguments::FitArgs;
use self::results::Results;
use crate::{
    failure::Failure,
    files::output_folder,
    image_fit::{self, FitImage, batch},
    memory::{self, Need},
    terminal::output::{self, quoted},
    training::{self, job::Job},
};

/// Fits Gaussians to images and writes the results.
pub(crate) fn run(args: &FitArgs) -> Result<(), Failure> {
    match batch::several(&args.images)? {
        None => run_one(args),
        Some(images) => several::run(args, &images),
    }
}

fn run_one(args: &FitArgs) -> Result<(), Failure> {
    let image = args.images.first().map(PathBuf::as_path);
    let job = args.job(image, &args.run.output)?;
    output_folder::check(&job.claim)?;
    let file = args.settings.read_file()?;
    let target = read_target(args, image, file.as_ref())?;
    let start = match &args.resume {
        Some(file) => FitStart::Resumed(Box::new(read_checkpoint(file)?), file.clone()),
        None => FitStart::fresh(args, file.as_ref(), &target)?,
    };
    let backend = args.run.backend.open_to_render_2d(&start.render())?;
    fit(job, &target, start, &backend)
}

fn read_target(args: &FitArgs, image: Option<&Path>, file: Option<&FitSettings>) -> Result<FitImage, Failure> {
    image.map_or(Ok(()), memory::check_image)?;
    Ok(FitImage::read(image, args.settings.behind(file))?)
}

/// Where a fit begins.
enum FitStart {
    Fresh(Box<FitSettings>),
    /// A checkpoint and its file.
    Resumed(Box<Checkpoint>, PathBuf),
}

impl FitStart {
    /// The start with the settings that flags and file ask for.
    fn fresh(args: &FitArgs, file: Option<&FitSettings>, target: &FitImage) -> Result<Self, Failure> {
        let mut settings = image_fit::settings(&args.settings, file, target)?;
        settings.render = args.run.effects.choice().for_training(&settings.render);
        Ok(Self::Fresh(Box::new(settings)))
    }

    /// The render settings of the fit. The default if a checkpoint has none: resuming it will fail.
    fn render(&self) -> RenderSettings {
        match self {
            Self::Fresh(settings) => settings.render,
            Self::Resumed(checkpoint, _) => {
                let text = checkpoint.metadata.get("settings").map_or("", String::as_str);
                FitSettings::from_toml(text, Path::new("checkpoint"))
                    .map_or_else(|_| RenderSettings::default(), |settings| settings.render)
            }
        }
    }

    /// The trainer at the start, and its log so far.
    fn begin<'r>(
        self,
        rasterizer: &'r AnyRasterizer,
        target: &FitImage,
    ) -> Result<(Trainer<'r, AnyRasterizer>, MetricsLog), Failure> {
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

fn fit(job: Job, target: &FitImage, start: FitStart, backend: &Chosen) -> Result<(), Failure> {
    let (trainer, log) = start.begin(&backend.rasterizer, target)?;
    let command = command(target, &job.claim.path);
    let (run, checkpoints) = job.begin(&trainer, None, command)?;
    announce(target, run.folder.path(), backend, &trainer);
    let results = Results { run: &run, target, backend };
    training::run(&run, checkpoints, (trainer, log), None, |trainer, log, points| results.write(trainer, log, points))
}

/// How to reduce the memory of a fit.
const LESS: &str = "use a smaller image, fewer Gaussians, or gs encode, which divides the image into bands";

/// Fails where there is not enough memory to fit this image.
fn check_memory(target: &FitImage, settings: &FitSettings) -> Result<(), Failure> {
    let (width, height) = target.image.size();
    let (bytes, held) = (settings.peak_bytes((width, height)), size_of_val(target.image.pixels()) as u64);
    let what = format!("fitting {} Gaussians to {} ({width}x{height} px)", settings.gaussians, target.name());
    Need { what, bytes, held, less: LESS }.check_and_print()
}

/// Why a checkpoint cannot be resumed.
fn not_resumed(error: gs_train::Error, file: &Path) -> Failure {
    let wrong_target = matches!(error, gs_train::Error::WrongTarget { .. });
    let failure = Failure::from(error).at(file.display());
    if wrong_target { failure.hint("give the same image and --background") } else { failure }
}

fn announce(target: &FitImage, folder: &Path, backend: &Chosen, trainer: &Trainer<'_, AnyRasterizer>) {
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
        folder.display()
    ));
}

/// The command that resumes the fit, without its flag `--resume`.
fn command(target: &FitImage, folder: &Path) -> String {
    let image = target.file.as_ref().map_or_else(String::new, |file| format!(" {}", quoted(file)));
    let background = target.behind.map_or_else(String::new, |color| format!(" --background {color}"));
    format!("gs fit{image}{background} -o {}", quoted(folder))
}

#[cfg(test)]
mod tests {
    use std::{process::ExitCode, thread, time::Duration};

    use clap::Parser;

    use super::*;
    use gs_backend::Wanted;

    #[derive(Debug, Parser)]
    struct Flags {
        #[command(flatten)]
        fit: FitArgs,
    }

    fn flags(words: &[&str]) -> FitArgs {
        Flags::try_parse_from(["fit"].iter().chain(words)).unwrap().fit
    }

    #[test]
    fn a_lost_wgpu_device_ends_the_fit_with_one_line_that_says_how_to_go_on() {
        let place = tempfile::tempdir().unwrap();
        let (output, state) = (place.path().join("out"), place.path().join("state"));
        let (output_flag, state_flag) = (output.to_str().unwrap(), state.to_str().unwrap());
        let words = ["-o", output_flag, "-n", "30", "-i", "1000000", "--checkpoint", state_flag];
        let args = flags(&[&words[..], &["--checkpoint-every", "10"]].concat());
        let target = FitImage::read(None, None).unwrap();
        let job = args.job(None, &output).unwrap();
        let settings = image_fit::settings(&args.settings, None, &target).unwrap();
        let wgpu = crate::flags::backend::BackendArgs { backend: Wanted::Wgpu, ..Default::default() };
        let backend = wgpu.open().expect("`cargo xtask test` installs a driver");
        let failure = thread::scope(|scope| {
            scope.spawn(|| {
                while !state.exists() {
                    thread::sleep(Duration::from_millis(5));
                }
                let AnyRasterizer::Wgpu(gpu) = &backend.rasterizer else { panic!("another backend") };
                gpu.lose_device();
            });
            let start = FitStart::Fresh(Box::new(settings));
            fit(job, &target, start, &backend).unwrap_err()
        });
        let line = failure.line().unwrap();
        assert!(line.starts_with("error: backend wgpu: ") && line.contains("the device was lost"), "{line}");
        assert!(line.ends_with(&format!(": gs fit -o {output_flag} --resume {state_flag}")), "{line}");
        assert_eq!(failure.status(), ExitCode::FAILURE);
        assert!(read_checkpoint(&state).is_ok());
        assert_eq!(place.path().read_dir().unwrap().count(), 2, "the folder and the checkpoint");
        let names = output.read_dir().unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let left: Vec<_> = names.filter(|name| !name.starts_with(".gs-")).collect();
        assert_eq!(left, ["metrics.part.csv"], "no results, and no incomplete files");
        let metrics = std::fs::read_to_string(output.join("metrics.part.csv")).unwrap();
        assert!(metrics.lines().nth(1).is_some_and(|row| row.starts_with("1,")), "{metrics}");
    }

    #[test]
    fn the_hint_about_the_image_is_for_another_image_only() {
        let line = |error| not_resumed(error, Path::new("state")).line().unwrap();
        let (expected, found) = ("1x1".to_owned(), "2x2".to_owned());
        assert!(
            line(gs_train::Error::WrongTarget { expected, found }).ends_with(": give the same image and --background")
        );
        assert!(line(gs_train::Error::Checkpoint("no step".to_owned())).ends_with(": no step"));
    }
}
