//! `gs study replay`: a row done again, as a fit of its own.

use gs_core::{Optimizer, Scene2d, counted};
use gs_io::{File2d, FolderClaim, Inputs, write_png, write_scene};
use gs_lab::{
    Places, Plan, Study, StudyFolder,
    study::{Machine, Replayed, Run, recorded_run, replay},
};

use crate::{
    backend::{Backend, Task, machine},
    failure::Failure,
    output,
    output_folder::{self, OutputFolder},
    settings_file::to_toml,
    study::{arguments::ReplayArgs, places},
};

/// The files that are written.
const FILES: [&str; 4] = ["scene.gs2d.safetensors", "reconstruction.png", "settings.toml", "summary.json"];

/// Replays a row and writes its fit.
///
/// # Errors
/// Where there is no such row, or it ends in another scene than the recorded one.
pub(super) fn run(args: &ReplayArgs) -> Result<(), Failure> {
    let folder = StudyFolder::open(&args.folder)?;
    let file = folder.study_file();
    let output = args.output.clone().unwrap_or_else(|| args.folder.join(format!("replay-{}", args.row)));
    let claim = args.overwrite.claim(&output, FILES, Inputs::from_iter([&file]));
    output_folder::check(&claim)?;
    let text = std::fs::read_to_string(&file)
        .map_err(|error| Failure::failed(format_args!("cannot be read: {error}")).at(file.display()))?;
    let study = Study::from_toml(&text, &file.display().to_string())?;
    let backend = start(args, folder.machine())?;
    let places = Places { remembered: folder.images(), ..places(args.data.as_deref(), None) };
    let plan = Plan::new(study, &places, machine(&backend))?;
    output::note(format_args!("row {}: {}", args.row, plan.describe(recorded_run(&plan, args.row, &folder)?)));
    let replayed = backend.run(Again { plan: &plan, row: args.row, folder: &folder })?;
    write(recorded_run(&plan, args.row, &folder)?, &replayed, claim)?;
    output::result(format_args!(
        "row {}: the recorded scene, bit for bit: {}, {:.2} dB; see {}",
        args.row,
        counted(replayed.finished.gaussians, "Gaussian"),
        replayed.finished.psnr,
        output.display()
    ))
}

/// The backend of the flags or, where they leave it open, that on which the study was conducted.
fn start(args: &ReplayArgs, recorded: Option<Machine>) -> Result<Backend, Failure> {
    let Some(recorded) = recorded else { return Backend::start(&args.backend) };
    let flags = args.backend.or_recorded(&recorded);
    Backend::start(&flags).map_err(|failure| failure.at(format_args!("recorded on {}", recorded.name)))
}

struct Again<'a> {
    plan: &'a Plan,
    row: usize,
    folder: &'a StudyFolder,
}

impl Task for Again<'_> {
    type Output = Result<Replayed, Failure>;

    fn run<R: Optimizer<Scene2d>>(self, rasterizer: &R) -> Self::Output {
        Ok(replay(self.plan, self.row, rasterizer, self.folder)?)
    }
}

/// What `gs fit` writes, without what explains it.
fn write(run: &Run, replayed: &Replayed, claim: FolderClaim) -> Result<(), Failure> {
    let Replayed { scene, image, settings: render, finished } = replayed;
    let folder = OutputFolder::begin(claim)?;
    let (width, height) = image.size();
    write_scene(
        folder.file("scene.gs2d.safetensors"),
        &File2d { scene: scene.clone(), width, height, settings: *render },
    )?;
    write_png(folder.file("reconstruction.png"), image)?;
    folder.write("settings.toml", &to_toml(&run.settings)?)?;
    folder.write_json("summary.json", finished)
}
