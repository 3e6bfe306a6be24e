//! `gs paper`: the experiments of the paper, and a page that sets what it says beside what was measured.

mod progress;

use std::{path::PathBuf, time::Instant};

use clap::{
    Args,
    builder::{PossibleValuesParser, TypedValueParser as _},
};
use gs_core::{Optimizer, Scene2d, Scene3d, counted, profile::Profiler};
use gs_io::Inputs;
use gs_lab::experiments::{Chapter, Experiment, Extent, Findings, Laboratory, PageSetting, claims_csv, page};

use crate::{
    backend::{Backend, BackendArgs, Task},
    failure::{self, Failure},
    output,
    output_folder::{self, OutputFolder, OverwriteArgs},
    paper::progress::Display,
};

const AFTER_HELP: &str = "\
The experiments:
  set-up            20 large Gaussians become 600; what growth is worth
  cold-start        small Gaussians on the border that nothing pulls, and the cure
  lazy-convergence  the absolute threshold, forced growth, and why no threshold is universal
  instability       a scale driven to zero, without guards and with them
  edges             where the Gaussians stand, and how they are stretched
  popping           orders of blending before a moving camera, in 3D

DIR then holds index.html, which needs nothing beside it and no network; claims.csv, every claim with its verdict and numbers; and a folder \
for each experiment with its tables and curves (CSV), charts (PNG and SVG) and pictures (PNG). Verdicts are computed from what was \
measured. The same backend gives the same numbers each time.";

/// The flags of `gs paper`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct PaperArgs {
    /// Folder for the results; made if it is not there
    #[arg(short, long, value_name = "DIR", default_value = "gs-paper")]
    output: PathBuf,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Make this experiment alone
    #[arg(long, value_name = "NAME", value_parser = experiment_parser())]
    only: Option<Experiment>,
    /// Fewer seeds and steps, for a first look
    #[arg(long)]
    quick: bool,
    #[command(flatten)]
    backend: BackendArgs,
}

fn experiment_parser() -> impl clap::builder::TypedValueParser<Value = Experiment> {
    PossibleValuesParser::new(Experiment::ALL.map(Experiment::name)).try_map(|name| Experiment::from_name(&name))
}

/// The page.
const PAGE: &str = "index.html";
/// The table of claims.
const CLAIMS: &str = "claims.csv";

/// Makes the experiments and writes their results.
///
/// # Errors
/// Where flags or the output folder are not possible, or the backend fails.
pub(crate) fn run(args: &PaperArgs) -> Result<(), Failure> {
    let started = Instant::now();
    let experiments = args.only.map_or_else(|| Experiment::ALL.to_vec(), |only| vec![only]);
    let claim = args.overwrite.claim(&args.output, [CLAIMS, PAGE], Inputs::default());
    let claim = claim.folders(experiments.iter().map(|experiment| experiment.name()));
    output_folder::check(&claim)?;
    let backend = Backend::start(&args.backend)?;
    let folder = OutputFolder::begin(claim)?;
    output::note(&backend.reason);
    let extent = if args.quick { Extent::Quick } else { Extent::Full };
    let chapters = backend.run(Experiments { experiments, extent, folder: &folder })?;
    folder.write(CLAIMS, claims_csv(&chapters))?;
    let page = page(&chapters, PageSetting { extent, only: args.only, backend: &backend.reason })?;
    folder.write(PAGE, page)?;
    output::note(format_args!(
        "{} in {:.0} s; see {}",
        verdicts(chapters.iter().flat_map(|chapter| &chapter.findings.claims)),
        started.elapsed().as_secs_f64(),
        folder.file(PAGE).display()
    ));
    Ok(())
}

struct Experiments<'a> {
    experiments: Vec<Experiment>,
    extent: Extent,
    folder: &'a OutputFolder,
}

impl Task for Experiments<'_> {
    type Output = Result<Vec<Chapter>, Failure>;

    fn run<R: Profiler<Scene2d> + Optimizer<Scene3d>>(self, rasterizer: &R) -> Result<Vec<Chapter>, Failure> {
        let mut display = Display::new(self.experiments.len());
        let voice = display.voice();
        // Every experiment is written whole or not at all: there is nothing to save.
        let quitting = voice.clone();
        let listening = ctrlc::set_handler(move || {
            quitting.clear();
            failure::quit_now();
        });
        if let Err(error) = listening {
            output::note(format_args!("note: Ctrl-C may leave a temporary file: {error}"));
        }
        let (mut chapters, count) = (Vec::new(), self.experiments.len());
        for experiment in self.experiments {
            let started = Instant::now();
            display.begin(experiment);
            let made = experiment.run(&mut Laboratory::new(rasterizer, self.extent, &mut display));
            let written = made.map_err(Failure::from).and_then(|findings| {
                self.folder.make(experiment.name())?;
                write_findings(self.folder, &format!("{experiment}/"), &findings)?;
                Ok(Chapter { experiment, findings })
            });
            let chapter = written.inspect_err(|_| voice.clear())?;
            let told = verdicts(&chapter.findings.claims);
            chapters.push(chapter);
            let left = match count - chapters.len() {
                0 => String::new(),
                left => format!("; {} left", counted(left, "experiment")),
            };
            voice.say(format_args!("{experiment}: {told}; {:.1} s{left}", started.elapsed().as_secs_f64()));
        }
        voice.clear();
        Ok(chapters)
    }
}

/// Writes tables, figures and pictures, all of whose names in the folder begin with `part`.
///
/// # Errors
/// Where a file is in the way or cannot be written, or a figure cannot be drawn.
pub(crate) fn write_findings(folder: &OutputFolder, part: &str, findings: &Findings) -> Result<(), Failure> {
    let files = findings.files(part)?;
    folder.claim(files.iter().map(|file| file.name.clone()))?;
    files.into_iter().try_for_each(|file| folder.write(&file.name, file.bytes))
}

/// "3 claims confirmed, 1 partly".
fn verdicts<'a>(claims: impl IntoIterator<Item = &'a gs_lab::experiments::Claim>) -> String {
    use gs_lab::experiments::Verdict::{Confirmed, Partly, Refuted};
    let claims: Vec<_> = claims.into_iter().collect();
    let of = |verdict| claims.iter().filter(|claim| claim.verdict() == verdict).count();
    let numbers = [Confirmed, Partly, Refuted].map(|verdict| (of(verdict), verdict));
    let told: Vec<String> =
        numbers.iter().filter(|(n, _)| *n > 0).map(|(n, verdict)| format!("{n} {verdict}")).collect();
    format!("{}: {}", counted(claims.len(), "claim"), told.join(", "))
}
