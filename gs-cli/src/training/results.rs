//! Results that a fit and a training have in common.

use std::path::Path;

use gs_backend::Chosen;
use gs_core::examination::{self, Examinable};
use gs_lab::report::curve::{self, CurvePoint};
use gs_train::MetricsLog;
use serde::Serialize;

use super::job::Run;
pub(crate) use super::{observers::write_table, problems::Problems};
use crate::{
    failure::Failure,
    files::output_folder::OutputFolder,
    memory,
    terminal::output::{self, Verbosity},
};

/// The files of a run's results, in which the files of another kind of run must not stay.
pub(crate) const FILES: [&str; 10] = [
    "scene.gs2d.safetensors",
    "scene.ply",
    "reconstruction.png",
    "ellipses.png",
    "evaluation.json",
    "metrics.csv",
    "metrics.part.csv",
    "curve.svg",
    "settings.toml",
    "summary.json",
];

/// What `summary.json` holds and `--json` prints.
pub(crate) trait Summary: Serialize {
    /// The summary as text.
    fn text(&self, folder: &Path, verbosity: Verbosity) -> String;
}

/// The part of a summary about the machine and the program.
#[derive(Debug, Serialize)]
pub(crate) struct ProgramSummary {
    /// The GPU or software driver; `null` on the CPU.
    adapter: Option<String>,
    /// SIMD level; `null` on a GPU.
    simd: Option<String>,
    /// The whole time of the program, including that of the run before it was resumed, s.
    pub(crate) total_seconds: f64,
    /// The peak memory of the program, bytes; `null` where the system does not report it.
    peak_memory: Option<u64>,
}

impl ProgramSummary {
    /// Summarizes a run on this backend.
    pub(crate) fn new(backend: &Chosen, run: &Run) -> Self {
        Self {
            adapter: backend.rasterizer.adapter().map(str::to_owned),
            simd: backend.rasterizer.simd_level(),
            total_seconds: run.seconds(),
            peak_memory: memory::peak(),
        }
    }
}

/// Writes the summary, or removes what an earlier run left of these files, and fails with the first
/// failure among the results.
pub(crate) fn end<T: Serialize, const N: usize>(
    folder: &OutputFolder,
    mut tried: Vec<Result<(), Failure>>,
    summary: Result<T, Failure>,
    files: [&str; N],
) -> Result<T, Failure> {
    match &summary {
        Ok(summary) => tried.push(folder.write_json("summary.json", summary)),
        Err(failure) => tried.extend([Err(failure.clone()), folder.leave_out(files)]),
    }
    Failure::first_of(tried)?;
    summary
}

/// Draws the curve of count, loss and PSNR.
pub(crate) fn write_curve(
    folder: &OutputFolder,
    points: &[CurvePoint],
    log: &MetricsLog,
    title: &str,
) -> Result<(), Failure> {
    folder.write("curve.svg", curve::draw(points, log.rows(), title))
}

/// The scene without Gaussians that cannot be drawn, which no file accepts; a run that was stopped
/// may have some. Their number is printed.
pub(crate) fn without_broken<S: Examinable>(mut scene: S) -> Result<S, Failure> {
    match examination::repair(&mut scene)?.removed {
        0 => {}
        1 => output::note("note: 1 Gaussian is not finite and is left out of the scene"),
        removed => output::note(format_args!("note: {removed} Gaussians are not finite and are left out of the scene")),
    }
    Ok(scene)
}
