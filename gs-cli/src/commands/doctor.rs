//! `gs doctor`: finds broken and doubtful Gaussians of a scene.

use std::{fmt::Write, path::PathBuf};

use clap::Args;
use gs_core::{
    Choice as _, counted,
    examination::{Finding, Remedy, examine},
};
use gs_io::{AnyScene, SceneFile, Values};
use serde::Serialize;

use crate::{
    failure::Failure,
    files::scene,
    terminal::output::{self, quoted},
};

const AFTER_HELP: &str = "\
A broken Gaussian draws nothing, or keeps the scene from being read. A doubtful one is drawn, but \
probably not as intended. gs convert SCENE OUT --drop-broken writes a copy whose broken Gaussians are \
repaired or left out, and whose others stay as they are: bit for bit in PLY and .gs2d.safetensors, \
otherwise as exactly as the format allows.

Exit status: 0 nothing is broken; 1 something is broken, or the scene cannot be read; 2 bad usage.";

/// The flags of `gs doctor`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct DoctorArgs {
    /// The scene: a scene file, a checkpoint, or the output folder of gs fit or gs train
    scene: PathBuf,
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
}

/// One finding.
#[derive(Debug, Serialize)]
struct Line {
    finding: Finding,
    /// The finding in words that complete "a Gaussian whose …".
    meaning: &'static str,
    count: usize,
    /// The index of the first such Gaussian.
    first: usize,
    remedy: Remedy,
}

/// Examines a scene.
pub(crate) fn run(args: &DoctorArgs) -> Result<(), Failure> {
    let SceneFile { path, scene, .. } = scene::read(&args.scene, Values::Any)?;
    let (kind, examination) = match &scene {
        AnyScene::TwoD(file) => ("2D scene".to_owned(), examine(&file.scene)?),
        AnyScene::ThreeD(file) => (format!("3D scene, {}", file.format), examine(&file.scene)?),
    };
    let (gaussians, broken) = (examination.gaussians, examination.broken());
    let findings = examination.cases.iter().map(|case| Line {
        finding: case.finding,
        meaning: case.finding.summary(),
        count: case.count,
        first: case.first,
        remedy: case.finding.remedy(),
    });
    let report = Report { file: path.display().to_string(), kind, gaussians, broken, findings: findings.collect() };
    output::answer(args.json, &report, || text(&report))?;
    if broken == 0 {
        return Ok(());
    }
    let what = format_args!("{broken} of {} are broken", counted(gaussians, "Gaussian"));
    let hint = format_args!("gs convert {} OUT --drop-broken writes a copy without", quoted(&args.scene));
    Err(Failure::failed(what).at(args.scene.display()).hint(hint))
}

fn text(report: &Report) -> String {
    let Report { kind, gaussians, findings, .. } = report;
    let mut text = format!("{:<12}{kind}, {}\n", "scene", counted(*gaussians, "Gaussian"));
    for (is_broken, mut name) in [(true, "broken"), (false, "doubtful")] {
        for Line { meaning, count, first, remedy, .. } in
            findings.iter().filter(|line| line.finding.is_broken() == is_broken)
        {
            let remedy = match remedy {
                Remedy::Remove => ": gs convert --drop-broken removes them",
                Remedy::Widen => ": gs convert --drop-broken makes it the smallest that there is",
                Remedy::Leave => "",
            };
            let _ = writeln!(text, "{name:<12}{count} (first: Gaussian {first}) whose {meaning}{remedy}");
            name = "";
        }
        if !name.is_empty() {
            let _ = writeln!(text, "{name:<12}none");
        }
    }
    text.truncate(text.trim_end().len());
    text
}
