//! `gs study replay`: repeats a row as a fit of its own.

use gs_backend::Chosen;
use gs_core::counted;
use gs_io::{File2d, FolderClaim, Inputs, write_2d, write_png};
use gs_lab::{
    StudyFolder,
    study::{Machine, Replayed, Run, recorded_run, replay},
};

use super::{arguments::ReplayArgs, prepare::HeldStudy};
use crate::{
    backend::machine,
    failure::Failure,
    output,
    output_folder::{self, OutputFolder},
};

/// The files that are written.
const FILES: [&str; 4] = ["scene.gs2d.safetensors", "reconstruction.png", "settings.toml", "summary.json"];

/// Replays a row and writes its fit.
pub(super) fn run(args: &ReplayArgs) -> Result<(), Failure> {
    let folder = StudyFolder::open(&args.folder)?;
    let file = folder.study_file();
    let output = args.output.clone().unwrap_or_else(|| args.folder.join(format!("replay-{}", args.row)));
    let claim = args.overwrite.claim(&output, FILES, Inputs::from_iter([&file]));
    output_folder::check(&claim)?;
    let held = HeldStudy::read(folder, args.data.as_deref())?;
    let folder = &held.folder;
    let backend = open(args, folder.machine())?;
    let plan = held.plan(machine(&backend.rasterizer))?;
    output::note(format_args!("row {}: {}", args.row, plan.describe(recorded_run(&plan, args.row, folder)?)));
    let replayed = replay(&plan, args.row, &backend.rasterizer, folder)?;
    write(recorded_run(&plan, args.row, folder)?, &replayed, claim)?;
    output::result(format_args!(
        "row {}: the recorded scene, bit for bit: {}, {:.2} dB; see {}",
        args.row,
        counted(replayed.finished.gaussians, "Gaussian"),
        replayed.finished.psnr,
        output.display()
    ))
}

/// The backend of the flags, or that of the study.
fn open(args: &ReplayArgs, recorded: Option<Machine>) -> Result<Chosen, Failure> {
    let Some(recorded) = recorded else { return args.backend.open() };
    args.backend
        .or_recorded(&recorded)
        .open()
        .map_err(|failure| failure.at(format_args!("recorded on {}", recorded.name)))
}

/// Writes what `gs fit` writes, without the pictures that explain it.
fn write(run: &Run, replayed: &Replayed, claim: FolderClaim) -> Result<(), Failure> {
    let Replayed { scene, image, settings: render, finished } = replayed;
    let folder = OutputFolder::begin(claim)?;
    let (width, height) = image.size();
    write_2d(
        folder.file("scene.gs2d.safetensors"),
        &File2d { scene: scene.clone(), width, height, settings: *render },
    )?;
    write_png(folder.file("reconstruction.png"), image)?;
    folder.write("settings.toml", &run.settings.to_toml().map_err(Failure::failed)?)?;
    folder.write_json("summary.json", finished)
}
