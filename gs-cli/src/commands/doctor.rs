//! `gs doctor`: what is wrong with a scene, 2D or 3D, and a copy of it in which that is mended.

use std::{
    fmt::Write,
    path::{Path, PathBuf},
};

use clap::Args;
use gs_core::{
    Scene, counted,
    examination::{Examinable, Examination, Finding, Remedy, Repair, examine, repair},
};
use gs_io::{ConversionLoss, Format3d, WriteOptions3d};
use gs_train::{Opened, OpenedScene, Values};
use serde::Serialize;

use crate::{
    failure::Failure,
    fit::quoted,
    opened,
    output::{self, Format},
    output_folder,
};

const STATUS: &str = "\
Broken is a Gaussian that draws nothing, or that keeps the scene from being read; doubtful is one that is drawn, but is probably not what was \
meant. --fix mends what is broken and leaves everything else as it is: in PLY and .gs2d.safetensors bit for bit, in other formats as closely as \
they hold it, which is told.

Exit status: 0 nothing is broken, or it has been mended; 1 something is broken, or the scene cannot be read; 2 bad usage.";

/// The flags of `gs doctor`.
#[derive(Debug, Clone, Args)]
#[command(after_help = STATUS)]
pub(crate) struct DoctorArgs {
    /// A scene, 2D or 3D (PLY, .splat, SPZ, glTF), a checkpoint, or the output folder of gs fit or gs train
    scene: PathBuf,
    /// Write a copy in which what is broken is mended
    #[arg(long, requires = "output")]
    fix: bool,
    /// The file for the copy, which cannot be SCENE itself; of a 3D scene its ending says the format: .ply, .splat, .spz, .gltf or .glb
    #[arg(short, long, value_name = "FILE", requires = "fix")]
    output: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// What `gs doctor --json` prints.
#[derive(Debug, Serialize)]
struct Report {
    file: String,
    /// The kind of scene, and of file.
    kind: String,
    gaussians: usize,
    /// Broken Gaussians; those with several findings count once.
    broken: usize,
    findings: Vec<Line>,
    /// The repaired copy; `null` without `--fix`.
    fixed: Option<Fixed>,
}

/// One finding.
#[derive(Debug, Serialize)]
struct Line {
    finding: Finding,
    /// In words that complete "a Gaussian whose …".
    meaning: String,
    count: usize,
    /// The first Gaussian of which it was found.
    first: usize,
    remedy: Remedy,
}

#[derive(Debug, Serialize)]
struct Fixed {
    file: String,
    /// Gaussians in it.
    gaussians: usize,
    #[serde(flatten)]
    repair: Repair,
    /// What of the examined file is not in the copy besides, in words.
    lost: Vec<String>,
}

/// Examines a scene, and mends it where told to.
///
/// # Errors
/// Where it cannot be read, where something is broken and not to be mended, or where the copy cannot be written.
pub(crate) fn run(args: &DoctorArgs) -> Result<(), Failure> {
    let scene = opened::file_of(&args.scene);
    args.output.as_deref().map_or(Ok(()), |output| output_folder::check_file(output, [&scene]))?;
    let Opened { path, scene: patient, .. } = opened::open(&args.scene, Values::Any)?;
    let kind = match &patient {
        OpenedScene::TwoD(_) => "2D scene".to_owned(),
        OpenedScene::ThreeD { file, .. } => format!("3D scene, {}", file.format),
    };
    args.output.as_deref().map(|output| check_ending(output, &patient)).transpose()?;
    let examination = match &patient {
        OpenedScene::TwoD(file) => examine(&file.scene)?,
        OpenedScene::ThreeD { file, .. } => examine(&file.scene)?,
    };
    let fixed = args.output.as_deref().map(|output| fix(patient, output)).transpose()?;
    let mended = fixed.is_some();
    let report = Report::new(&path, kind, &examination, fixed);
    match if args.json { Format::Json } else { Format::Text } {
        Format::Json => output::json(&report)?,
        Format::Text => output::result(text(&report))?,
    }
    if examination.is_sound() || mended {
        return Ok(());
    }
    let scene = quoted(&args.scene);
    let what = format_args!("{} of {} are broken", examination.broken(), counted(examination.gaussians, "Gaussian"));
    let mend = format_args!("gs doctor {scene} --fix -o OUT writes a copy without");
    Err(Failure::failed(what).at(args.scene.display()).mend(mend))
}

/// Refuses a name for the copy that does not say a format of its kind of scene.
fn check_ending(output: &Path, scene: &OpenedScene) -> Result<(), Failure> {
    match scene {
        OpenedScene::TwoD(_) => {
            if output.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("safetensors")) {
                return Ok(());
            }
            let failure = Failure::usage("a 2D scene is not written in this format").at(output.display());
            Err(failure.mend(format_args!("let its name end in .{}", gs_io::SCENE_EXTENSION)))
        }
        OpenedScene::ThreeD { .. } => match Format3d::to_write(output) {
            Some(_) => Ok(()),
            None => Err(gs_io::Error::UnknownEnding { path: output.to_owned() }.into()),
        },
    }
}

/// Mends the scene and writes it.
fn fix(scene: OpenedScene, output: &Path) -> Result<Fixed, Failure> {
    match scene {
        OpenedScene::TwoD(mut file) => {
            let repair = mend(&mut file.scene, output)?;
            gs_io::write_scene(output, &file)?;
            Ok(Fixed::new(output, file.scene.len(), repair, &[]))
        }
        OpenedScene::ThreeD { mut file, .. } => {
            let repair = mend(&mut file.scene, output)?;
            let options = WriteOptions3d { trained_with: file.trained_with, ..WriteOptions3d::default() };
            let written = gs_io::write_3d(output, &file.scene, &options)?;
            let losses = [file.losses, written.losses].concat();
            Ok(Fixed::new(output, file.scene.len(), repair, &losses))
        }
    }
}

/// Mends a scene of which something must be left to write.
fn mend<S: Examinable>(scene: &mut S, output: &Path) -> Result<Repair, Failure> {
    let repair = repair(scene)?;
    match scene.is_empty() && repair.removed > 0 {
        true => Err(Failure::failed(format_args!("none of {} can be drawn", counted(repair.removed, "Gaussian")))
            .at(output.display())
            .mend("there is nothing to write; make the scene again")),
        false => Ok(repair),
    }
}

impl Fixed {
    fn new(output: &Path, gaussians: usize, repair: Repair, losses: &[ConversionLoss]) -> Self {
        let lost = losses.iter().map(ConversionLoss::to_string).collect();
        Self { file: output.display().to_string(), gaussians, repair, lost }
    }
}

impl Report {
    fn new(file: &Path, kind: String, examination: &Examination, fixed: Option<Fixed>) -> Self {
        let findings = examination.cases.iter().map(|case| Line {
            finding: case.finding,
            meaning: case.finding.to_string(),
            count: case.count,
            first: case.first,
            remedy: case.finding.remedy(),
        });
        Self {
            file: file.display().to_string(),
            kind,
            gaussians: examination.gaussians,
            broken: examination.broken(),
            findings: findings.collect(),
            fixed,
        }
    }
}

fn text(report: &Report) -> String {
    let Report { kind, gaussians, findings, fixed, .. } = report;
    let mut text = format!("{:<12}{kind}, {}\n", "scene", counted(*gaussians, "Gaussian"));
    let mut section = |name: &str, none: &str, is_broken: bool| {
        let mut name = name;
        for Line { meaning, count, first, remedy, .. } in
            findings.iter().filter(|line| line.finding.is_broken() == is_broken)
        {
            let remedy = match remedy {
                Remedy::Remove => ": --fix removes them",
                Remedy::Widen => ": --fix makes it the smallest that there is",
                Remedy::Leave => "",
            };
            let _ = writeln!(text, "{name:<12}{count} whose {meaning}, first Gaussian {first}{remedy}");
            name = "";
        }
        if !name.is_empty() {
            let _ = writeln!(text, "{name:<12}{none}");
        }
    };
    section("broken", "none", true);
    section("doubtful", "none", false);
    if let Some(Fixed { file, gaussians, repair: Repair { removed, widened, .. }, lost }) = fixed {
        let done = match (removed, widened) {
            (0, 0) => "nothing to mend".to_owned(),
            (removed, 0) => format!("{removed} removed"),
            (0, widened) => format!("{widened} widened"),
            (removed, widened) => format!("{removed} removed, {widened} widened"),
        };
        let _ = writeln!(text, "{:<12}{file}: {done}; {}", "fixed", counted(*gaussians, "Gaussian"));
        lost.iter().for_each(|loss| _ = writeln!(text, "{:<12}{loss}", "lost"));
    }
    text.truncate(text.trim_end().len());
    text
}
