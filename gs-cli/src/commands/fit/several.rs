//! `gs fit` of several images, each into a folder of its own.

use std::fs;

use gs_backend::Chosen;
use gs_train::{FitSettings, Preset};

use super::{FitArgs, FitStart, command, read_target, results::Results};
use crate::{
    failure::Failure,
    files::output_folder,
    image_fit::{
        FitImage, FitSettingsArgs,
        batch::{self, BatchImage, Done},
    },
    terminal::{
        interrupt::{AT_NEXT_STEP, Interrupt},
        output,
    },
    training::{self, Watched, job::Job},
};

/// Fits each image. What would fail for all fails before the first is begun: flags, settings, and
/// files that are in the way.
pub(super) fn run(args: &FitArgs, images: &[BatchImage]) -> Result<(), Failure> {
    for (flag, given) in [("--resume", args.resume.is_some()), ("--checkpoint", args.run.checkpoint.is_some())] {
        if given {
            return Err(Failure::usage("names the checkpoint of one fit, but there are several images").at(flag));
        }
    }
    let file = args.settings.read_file()?;
    for image in images {
        output_folder::check(&job_of(args, image)?.claim)?;
    }
    let stand_in = FitStart::fresh(args, file.as_ref(), &FitImage::stand_in(&images[0].file))?;
    let peak = |size| match &file {
        Some(settings) => settings.peak_bytes(size),
        None => {
            let settings = FitSettings::from_preset(Preset::Standard, size, args.settings.gaussians, None);
            let FitSettingsArgs { loss, tune, .. } = args.settings;
            let chosen = settings.with(|s| (s.loss, s.tune) = (loss.unwrap_or(s.loss), tune.unwrap_or(s.tune)));
            chosen.peak_bytes(size)
        }
    };
    let machine = (&args.run.backend, &stand_in.render());
    batch::run(images, machine, args.run.json, AT_NEXT_STEP, peak, |image, on, interrupt| {
        fit_one(args, image, file.as_ref(), on, interrupt)
    })
}

/// The fit of one of several images, into its folder.
fn job_of(args: &FitArgs, image: &BatchImage) -> Result<Job, Failure> {
    args.job(Some(&image.file), &args.run.output.join(&image.name))
}

fn fit_one(
    args: &FitArgs,
    image: &BatchImage,
    file: Option<&FitSettings>,
    on: &Chosen,
    interrupt: &Interrupt,
) -> Result<Done<super::results::Summary>, Failure> {
    let job = job_of(args, image)?;
    let target = read_target(args, Some(&image.file), file)?;
    target.remarks.iter().for_each(|remark| output::note(format_args!("{}: {remark}", target.name())));
    let start = FitStart::fresh(args, file, &target)?;
    let (trainer, log) = start.begin(&on.rasterizer, &target)?;
    let command = command(&target, &job.claim.path);
    let (run, checkpoints) = job.begin(&trainer, None, command)?;
    let results = Results { run: &run, target: &target, backend: on };
    let watched = Watched::silently(interrupt);
    let ended = training::complete(watched, &run.folder, checkpoints, (trainer, log), |trainer, log, points| {
        results.write(trainer, log, points)
    })?;
    ended.finish()?;
    let bytes = fs::metadata(run.folder.path().join("scene.gs2d.safetensors")).map_or(0, |file| file.len());
    Ok(Done { row: ended.summary.row(target.image.size(), bytes), summary: ended.summary })
}
