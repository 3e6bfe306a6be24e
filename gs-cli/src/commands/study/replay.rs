//! `gs study replay`: repeats a row as a fit or a training of its own.

use gs_backend::Chosen;
use gs_core::counted;
use gs_io::{File2d, FolderClaim, Inputs, TrainedWith, WriteOptions3d, write_2d, write_3d, write_png};
use gs_lab::{
    StudyFolder,
    run::{Replayed, ReplayedScene, replay},
    study::{Machine, Run},
};

use super::{arguments::ReplayArgs, prepare::HeldStudy};
use crate::{
    failure::Failure,
    files::output_folder::{self, OutputFolder},
    terminal::output,
};

/// The files that are written of a fit.
const FILES_2D: [&str; 4] = ["scene.gs2d.safetensors", "reconstruction.png", "settings.toml", "summary.json"];

/// The files that are written of a training, at most.
const FILES_3D: [&str; 6] = ["scene.ply", "settings.toml", "summary.json", "view-1.png", "view-2.png", "view-3.png"];

/// Replays a row and writes its scene.
pub(super) fn run(args: &ReplayArgs) -> Result<(), Failure> {
    let folder = StudyFolder::open(&args.folder, false)?;
    let file = folder.study_file();
    let output = args.output.clone().unwrap_or_else(|| args.folder.join(format!("replay-{}", args.row)));
    let held = HeldStudy::read(folder, args.data.as_deref())?;
    let files = if held.is_of_scenes() { &FILES_3D[..] } else { &FILES_2D };
    let claim = args.overwrite.claim(&output, files.iter().copied(), Inputs::from_iter([&file]));
    output_folder::check(&claim)?;
    let folder = &held.folder;
    let backend = open(args, folder.machine())?;
    let plan = held.plan(Machine::of(&backend.rasterizer))?;
    let begun = |run: &Run| output::note(format_args!("row {}: {}", args.row, plan.describe(run)));
    let replayed = replay(&plan, args.row, &backend.rasterizer, folder, &begun)?;
    write(&replayed, claim)?;
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

/// Writes what `gs fit` or `gs train` writes, without the pictures that explain it.
fn write(replayed: &Replayed, claim: FolderClaim) -> Result<(), Failure> {
    let Replayed { run, scene, frame, pictures, settings: render, finished } = replayed;
    let folder = OutputFolder::begin(claim)?;
    match (scene, &pictures[..]) {
        (ReplayedScene::TwoD(scene), [image]) => {
            let (width, height) = image.size();
            let file = File2d { scene: scene.clone(), width, height, settings: *render, profile: None };
            write_2d(folder.file("scene.gs2d.safetensors"), &file)?;
            write_png(folder.file("reconstruction.png"), image)?;
        }
        (ReplayedScene::ThreeD(scene), views) => {
            let trained_with = TrainedWith::default().with(|s| {
                s.antialias = Some(render.effects.antialias);
                s.order = Some(render.effects.order);
                s.frame = *frame;
            });
            write_3d(
                folder.file("scene.ply"),
                scene,
                &WriteOptions3d::default().with(|s| s.trained_with = trained_with),
            )?;
            for (name, view) in FILES_3D.iter().filter(|name| name.starts_with("view-")).zip(views) {
                write_png(folder.file(name), view)?;
            }
        }
        _ => return Err(Failure::failed("the replayed scene has no picture")),
    }
    folder.write("settings.toml", &run.settings_file().map_err(Failure::failed)?)?;
    folder.write_json("summary.json", finished)
}
