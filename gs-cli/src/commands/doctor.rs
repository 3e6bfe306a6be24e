//! `gs doctor`: finds broken and doubtful Gaussians of a scene, and writes a repaired copy.

use std::{
    fmt::Write,
    path::{Path, PathBuf},
};

use clap::Args;
use gs_core::{
    Choice as _, Scene, counted,
    examination::{Examinable, Examination, Finding, Remedy, Repair, examine, repair},
};
use gs_io::{AnyScene, ConversionLoss, Format3d, SceneFile, Values, WriteOptions3d};
use serde::Serialize;

use crate::{
    failure::Failure,
    files::{output_folder, scene},
    terminal::output::{self, quoted},
};

const AFTER_HELP: &str = "\
A broken Gaussian draws nothing, or keeps the scene from being read. A doubtful one is drawn, but \
probably not as intended. --fix repairs or removes broken Gaussians and leaves everything else as \
it is: bit for bit in PLY and .gs2d.safetensors, otherwise as exactly as the format allows. It \
prints what is lost.

Exit status: 0 nothing is broken, or it was repaired; 1 something is broken, or the scene cannot \
be read; 2 bad usage.";

/// The flags of `gs doctor`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct DoctorArgs {
    /// The scene: a scene file, a checkpoint, or the output folder of gs fit or gs train
    scene: PathBuf,
    /// Write a repaired copy
    #[arg(long, requires = "output")]
    fix: bool,
    #[arg(short, long, value_name = "FILE", requires = "fix", help = format!(
        "The file for the copy, other than SCENE; for a 3D scene with the ending of its format: {}",
        Format3d::endings()
    ))]
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
    /// The finding in words that complete "a Gaussian whose …".
    meaning: String,
    count: usize,
    /// The index of the first such Gaussian.
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
    /// What else the copy lacks, in words.
    lost: Vec<String>,
}

/// Examines a scene, and repairs it with `--fix`.
pub(crate) fn run(args: &DoctorArgs) -> Result<(), Failure> {
    let file = scene::file_of(&args.scene);
    args.output.as_deref().map_or(Ok(()), |output| output_folder::check_file(output, [&file]))?;
    let SceneFile { path, scene, .. } = scene::read(&args.scene, Values::Any)?;
    args.output.as_deref().map(|output| check_ending(output, &scene)).transpose()?;
    let (kind, examination) = match &scene {
        AnyScene::TwoD(file) => ("2D scene".to_owned(), examine(&file.scene)?),
        AnyScene::ThreeD(file) => (format!("3D scene, {}", file.format), examine(&file.scene)?),
    };
    let fixed = args.output.as_deref().map(|output| fix(scene, output)).transpose()?;
    let is_fixed = fixed.is_some();
    let report = Report::new(&path, kind, &examination, fixed);
    output::answer(args.json, &report, || text(&report))?;
    if examination.broken() == 0 || is_fixed {
        return Ok(());
    }
    let scene = quoted(&args.scene);
    let what = format_args!("{} of {} are broken", examination.broken(), counted(examination.gaussians, "Gaussian"));
    let hint = format_args!("gs doctor {scene} --fix -o OUT writes a copy without");
    Err(Failure::failed(what).at(args.scene.display()).hint(hint))
}

/// Refuses a name for the copy without the ending of a format for this kind of scene.
fn check_ending(output: &Path, scene: &AnyScene) -> Result<(), Failure> {
    match scene {
        AnyScene::TwoD(_) => {
            if scene::is_scene_2d(output) {
                return Ok(());
            }
            let failure = Failure::usage("cannot write a 2D scene in this format").at(output.display());
            Err(failure.hint(format_args!("let its name end in .{}", gs_io::SCENE_EXTENSION)))
        }
        AnyScene::ThreeD(_) => match Format3d::to_write(output) {
            Some(_) => Ok(()),
            None => Err(Format3d::unknown_ending(output).into()),
        },
    }
}

/// Repairs the scene and writes it.
fn fix(scene: AnyScene, output: &Path) -> Result<Fixed, Failure> {
    match scene {
        AnyScene::TwoD(mut file) => {
            let repair = repaired(&mut file.scene, output)?;
            gs_io::write_2d(output, &file)?;
            Ok(Fixed::new(output, file.scene.len(), repair, &[]))
        }
        AnyScene::ThreeD(mut file) => {
            let repair = repaired(&mut file.scene, output)?;
            let options = WriteOptions3d::default().with(|s| s.trained_with = file.trained_with);
            let written = gs_io::write_3d(output, &file.scene, &options)?;
            let losses = [file.losses, written.losses].concat();
            Ok(Fixed::new(output, file.scene.len(), repair, &losses))
        }
    }
}

/// Repairs a scene, of which a Gaussian must be left.
fn repaired<S: Examinable>(scene: &mut S, output: &Path) -> Result<Repair, Failure> {
    let repair = repair(scene)?;
    match scene.is_empty() && repair.removed > 0 {
        true => Err(Failure::failed(format_args!("none of {} can be drawn", counted(repair.removed, "Gaussian")))
            .at(output.display())
            .hint("there is nothing to write; make the scene again")),
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
            meaning: case.finding.summary().to_owned(),
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
            let _ = writeln!(text, "{name:<12}{count} (first: Gaussian {first}) whose {meaning}{remedy}");
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
            (0, 0) => "nothing to repair".to_owned(),
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
