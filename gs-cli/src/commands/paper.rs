//! `gs paper`: the experiments of the paper, and a page that compares its claims with measurements.

use std::{path::PathBuf, time::Instant};

use clap::{
    Args,
    builder::{PossibleValuesParser, TypedValueParser},
};
use gs_backend::AnyRasterizer;
use gs_core::counted;
use gs_io::Inputs;
use gs_jobs::WorkSettings;
use gs_lab::{
    Existing, Places, Plan, Results, StudyFolder, conduct,
    experiments::{Chapter, EXPERIMENTS, Experiment, claims_csv, page, verdicts},
    report,
    run::{Conducted, Preparation},
    study::Machine,
};

use super::study::Display;
use crate::{
    failure::Failure,
    files::output_folder::{self, OutputFolder, OverwriteArgs},
    flags::backend::BackendArgs,
    terminal::{
        interrupt::{AT_NEXT_STEP, Interrupt},
        output,
        progress_bar::Printer,
    },
};

const AFTER_HELP: &str = "\
The experiments:
  set-up            20 large Gaussians become 600; what growth is worth
  cold-start        small Gaussians on the border that do not move, and the cure
  lazy-convergence  the absolute threshold, forced growth, and why no threshold is universal
  instability       what the paper's clamp of scales at 1 px costs
  edges             where the Gaussians stand, and how they are stretched

They are studies that come with the program. DIR then holds index.html, which needs no other file \
and no network; claims.csv, every claim with its verdict and numbers; and a folder for each study, \
as gs study makes it, with tables, curves and a report. Verdicts are computed from the measurements. The same backend gives the same numbers each time. \
Run the same command again to continue one that was stopped.";

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
    only: Option<&'static Experiment>,
    /// Fewer seeds and steps, for a first look
    #[arg(long)]
    quick: bool,
    #[command(flatten)]
    backend: BackendArgs,
}

fn experiment_parser() -> impl TypedValueParser<Value = &'static Experiment> {
    let of_name = |name: String| EXPERIMENTS.iter().find(|experiment| experiment.name == name);
    PossibleValuesParser::new(EXPERIMENTS.each_ref().map(|experiment| experiment.name))
        .map(move |name| of_name(name).expect("it is one of the possible values"))
}

/// The page.
const PAGE: &str = "index.html";
/// The table of claims.
const CLAIMS: &str = "claims.csv";

/// An experiment whose folders are made.
struct Prepared {
    experiment: &'static Experiment,
    studies: Vec<(Plan, StudyFolder)>,
}

/// Makes the experiments and writes their results.
pub(crate) fn run(args: &PaperArgs) -> Result<(), Failure> {
    let started = Instant::now();
    let experiments = args.only.map_or_else(|| EXPERIMENTS.iter().collect(), |only| vec![only]);
    // The folder of a study protects itself.
    let claim = args.overwrite.claim(&args.output, [CLAIMS, PAGE], Inputs::default());
    output_folder::check(&claim)?;
    let backend = args.backend.open()?;
    let folder = OutputFolder::begin(claim)?;
    output::note(&backend.reason);
    let prepare = |experiment| prepare(args, experiment, &backend.rasterizer);
    let prepared = experiments.into_iter().map(prepare).collect::<Result<Vec<_>, Failure>>()?;
    let interrupt = Interrupt::listen(Printer::above(None), AT_NEXT_STEP);
    let (mut chapters, count) = (Vec::new(), prepared.len());
    for prepared in &prepared {
        let (name, started) = (prepared.experiment.name, Instant::now());
        chapters.push(chapter(prepared, &backend.rasterizer, &interrupt)?);
        let left = match count - chapters.len() {
            0 => String::new(),
            left => format!("; {} left", counted(left, "experiment")),
        };
        let verdicts = verdicts(&chapters[chapters.len() - 1..]);
        output::note(format_args!("{name}: {verdicts}; {:.1} s{left}", started.elapsed().as_secs_f64()));
    }
    folder.write(CLAIMS, claims_csv(&chapters))?;
    folder.write(PAGE, page(&chapters, args.only, args.quick, &backend.reason))?;
    output::note(format_args!(
        "{} in {:.0} s; see {}",
        verdicts(&chapters),
        started.elapsed().as_secs_f64(),
        folder.file(PAGE).display()
    ));
    Ok(())
}

/// Plans the studies of an experiment and makes their folders, in which finished runs are kept.
fn prepare(args: &PaperArgs, experiment: &'static Experiment, on: &AnyRasterizer) -> Result<Prepared, Failure> {
    let how = Preparation { overwrite: args.overwrite.overwrite, ..Existing::Resume.into() };
    let mut studies = Vec::new();
    for study in experiment.studies(args.quick)? {
        let path = args.output.join(&study.name);
        let plan = Plan::new(study, &Places::default(), Machine::of(on))?;
        let folder = StudyFolder::prepare(&path, &plan, how.clone())?;
        studies.push((plan, folder));
    }
    Ok(Prepared { experiment, studies })
}

/// Makes an experiment and writes its results.
fn chapter(
    Prepared { experiment, studies }: &Prepared,
    on: &AnyRasterizer,
    interrupt: &Interrupt,
) -> Result<Chapter, Failure> {
    let mut chapter = Chapter::begun(experiment);
    for (plan, of_study) in studies {
        output::note(format_args!("{}: {}", plan.study.name, counted(plan.runs.len(), "run")));
        let display = Display::new(plan, of_study)?;
        let conducted = conduct(plan, &[on], of_study, &WorkSettings::default(), &display.stopped_by(interrupt));
        display.printer().clear_bar();
        if conducted? != Conducted::Whole {
            return Err(Failure::interrupted("stopped; the same command goes on"));
        }
        let results = Results::read(plan, of_study)?;
        report::write(&results, of_study, &format!("gs study {}", plan.study.name))?;
        chapter.add(&results);
    }
    Ok(chapter)
}
