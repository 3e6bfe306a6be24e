//! `gs paper`: the experiments of the paper, and a page that compares its claims with measurements.

mod progress;

use std::{path::PathBuf, time::Instant};

use clap::{
    Args,
    builder::{PossibleValuesParser, TypedValueParser as _},
};
use gs_backend::AnyRasterizer;
use gs_core::counted;
use gs_io::Inputs;
use gs_lab::experiments::{Chapter, Experiment, ExperimentSize, Laboratory, PageSetting, claims_csv, page};

use self::progress::Display;
use crate::{
    backend::BackendArgs,
    failure::Failure,
    interrupt::quit_on_ctrl_c,
    output,
    output_folder::{self, OutputFolder, OverwriteArgs},
};

const AFTER_HELP: &str = "\
The experiments:
  set-up            20 large Gaussians become 600; what growth is worth
  cold-start        small Gaussians on the border that do not move, and the cure
  lazy-convergence  the absolute threshold, forced growth, and why no threshold is universal
  instability       a scale driven to zero, without guards and with them
  edges             where the Gaussians stand, and how they are stretched
  popping           orders of blending under a moving camera, in 3D

DIR then holds index.html, which needs no other file and no network; claims.csv, every claim with \
its verdict and numbers; and a folder for each experiment with its tables and curves (CSV), charts \
(PNG and SVG) and pictures (PNG). Verdicts are computed from the measurements. The same backend \
gives the same numbers each time.";

/// The flags of `gs paper`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct PaperArgs {
    /// Folder for the results; made if necessary
    #[arg(short, long, value_name = "DIR", default_value = "gs-paper")]
    output: PathBuf,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Make only this experiment
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
pub(crate) fn run(args: &PaperArgs) -> Result<(), Failure> {
    let started = Instant::now();
    let experiments = args.only.map_or_else(|| Experiment::ALL.to_vec(), |only| vec![only]);
    let claim = args.overwrite.claim(&args.output, [CLAIMS, PAGE], Inputs::default());
    let claim = claim.folders(experiments.iter().map(|experiment| experiment.name()));
    output_folder::check(&claim)?;
    let backend = args.backend.open()?;
    let folder = OutputFolder::begin(claim)?;
    output::note(&backend.reason);
    let extent = if args.quick { ExperimentSize::Quick } else { ExperimentSize::Full };
    let chapters = make(experiments, extent, &backend.rasterizer, &folder)?;
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

/// Makes the experiments and writes the findings of each.
fn make(
    experiments: Vec<Experiment>,
    extent: ExperimentSize,
    rasterizer: &AnyRasterizer,
    folder: &OutputFolder,
) -> Result<Vec<Chapter>, Failure> {
    let mut display = Display::new(experiments.len());
    let printer = display.printer();
    // Every experiment is written completely or not at all, so there is nothing to save.
    quit_on_ctrl_c(printer.clone());
    let (mut chapters, count) = (Vec::new(), experiments.len());
    for experiment in experiments {
        let started = Instant::now();
        display.begin(experiment);
        let made = experiment.run(&mut Laboratory::new(rasterizer, extent, &mut display));
        let written = made.map_err(Failure::from).and_then(|findings| {
            folder.make(experiment.name())?;
            folder.write_findings(&format!("{experiment}/"), &findings)?;
            Ok(Chapter { experiment, findings })
        });
        let chapter = written.inspect_err(|_| printer.clear_bar())?;
        let verdicts = verdicts(&chapter.findings.claims);
        chapters.push(chapter);
        let left = match count - chapters.len() {
            0 => String::new(),
            left => format!("; {} left", counted(left, "experiment")),
        };
        printer.print(format_args!("{experiment}: {verdicts}; {:.1} s{left}", started.elapsed().as_secs_f64()));
    }
    printer.clear_bar();
    Ok(chapters)
}

/// "3 claims confirmed, 1 partly".
fn verdicts<'a>(claims: impl IntoIterator<Item = &'a gs_lab::experiments::Claim>) -> String {
    use gs_lab::experiments::ClaimVerdict::{Confirmed, Partly, Refuted};
    let claims: Vec<_> = claims.into_iter().collect();
    let of = |verdict| claims.iter().filter(|claim| claim.verdict() == verdict).count();
    let numbers = [Confirmed, Partly, Refuted].map(|verdict| (of(verdict), verdict));
    let verdicts: Vec<String> =
        numbers.iter().filter(|(n, _)| *n > 0).map(|(n, verdict)| format!("{n} {verdict}")).collect();
    format!("{}: {}", counted(claims.len(), "claim"), verdicts.join(", "))
}
