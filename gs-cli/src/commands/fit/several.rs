//! `gs fit` of several images, each into a folder of its own.

use std::{fs, time::Instant};

use gs_backend::Chosen;
use gs_train::{FitSettings, Preset};

use super::{FitArgs, Start, backend_args, command, film::Film, read_target, results::Results};
use crate::{
    failure::Failure,
    image_fit::{
        FitSettingsArgs, SettingsFile, Target,
        batch::{self, BatchImage, Done},
    },
    interrupt::{AT_NEXT_STEP, Interrupt},
    output,
    output_folder::{self, OutputFolder},
    training::{self, Watched, checkpoints::Checkpoints},
};

/// Fits each image. What would fail for all fails before the first is begun: flags, settings, and
/// files that are in the way.
pub(super) fn run(args: &FitArgs, images: &[BatchImage]) -> Result<(), Failure> {
    for (flag, given) in [("--resume", args.resume.is_some()), ("--checkpoint", args.checkpoints.checkpoint.is_some())]
    {
        if given {
            return Err(Failure::usage("names the checkpoint of one fit, but there are several images").at(flag));
        }
    }
    args.count.validate()?;
    let file = SettingsFile::read(&args.settings)?;
    for image in images {
        output_folder::check(&args.of_one(image).claim())?;
    }
    let stand_in = Start::fresh(args, &file, &Target::stand_in(&images[0].file))?;
    let peak = |size| match &file {
        SettingsFile::Fit(settings) => settings.peak_bytes(size),
        _ => {
            let settings = FitSettings::from_preset(Preset::Standard, size, args.settings.gaussians, None);
            let FitSettingsArgs { loss, tune, .. } = args.settings;
            let chosen = settings.with(|s| (s.loss, s.tune) = (loss.unwrap_or(s.loss), tune.unwrap_or(s.tune)));
            chosen.peak_bytes(size)
        }
    };
    let machine = (&backend_args(args, &file), &stand_in.render());
    batch::run(images, machine, args.output.json, AT_NEXT_STEP, peak, |image, on, interrupt| {
        fit_one(&args.of_one(image), &file, on, interrupt)
    })
}

fn fit_one(
    args: &FitArgs,
    file: &SettingsFile,
    on: &Chosen,
    interrupt: &Interrupt,
) -> Result<Done<super::results::Summary>, Failure> {
    let started = Instant::now();
    let target = read_target(args, file)?;
    target.remarks.iter().for_each(|remark| output::note(format_args!("{}: {remark}", target.name())));
    let start = Start::fresh(args, file, &target)?.counted(args, &target, on)?;
    let (trainer, log) = start.begin(&on.rasterizer, &target)?;
    let folder = OutputFolder::begin(args.claim())?;
    let iterations = trainer.settings().iterations;
    let checkpoints = Checkpoints::prepare(&args.checkpoints, &folder, iterations, None, None, command(args, &target))?;
    let film = args.film.then(|| Film::begin(&on.rasterizer, &trainer)).transpose()?;
    let film = film.as_ref();
    let results = Results { args, folder: &folder, target: &target, backend: on, started, seconds_before: 0.0, film };
    let watched = Watched::silently(interrupt, film.map(Film::as_frames));
    let ended = training::complete(watched, &folder, checkpoints, (trainer, log), |trainer, log, points| {
        results.write(trainer, log, points)
    })?;
    ended.finish()?;
    let bytes = fs::metadata(folder.path().join("scene.gs2d.safetensors")).map_or(0, |file| file.len());
    Ok(Done { row: ended.summary.row(target.image.size(), bytes), summary: ended.summary })
}
