//! `gs paper`: the experiments of the paper, and a page that compares its claims with measurements.

use std::{path::PathBuf, time::Instant};

use clap::{
    Args,
    builder::{PossibleValuesParser, TypedValueParser as _},
};
use gs_backend::AnyRasterizer;
use gs_core::counted;
use gs_io::Inputs;
use gs_lab::{
    Existing, Places, Plan, Results, StudyFolder, conduct,
    experiments::{Chapter, Experiment, ExperimentSize, PageSetting, page},
    report,
    result::{claims_csv, verdicts, write_tables},
    run::{Conducted, Safety},
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
  instability       a scale driven to zero, without guards and with them
  edges             where the Gaussians stand, and how they are stretched
  popping           orders of blending under a moving camera, in 3D

DIR then holds index.html, which needs no other file and no network; claims.csv, every claim with \
its verdict and numbers; and a folder for each experiment. All but popping are studies that come \
with the program, and their folders are those of gs study, with tables, curves and a report each. \
Measurements that no study contains are saved in the same folders as CSV, PNG and SVG files. \
Verdicts are computed from the measurements. The same backend gives the same numbers each time. \
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

/// An experiment whose folders are made.
struct Prepared {
    experiment: Experiment,
    studies: Vec<(Plan, StudyFolder)>,
}

/// Makes the experiments and writes their results.
pub(crate) fn run(args: &PaperArgs) -> Result<(), Failure> {
    let started = Instant::now();
    let experiments = args.only.map_or_else(|| Experiment::ALL.to_vec(), |only| vec![only]);
    let size = if args.quick { ExperimentSize::Quick } else { ExperimentSize::Full };
    let mut claim = args.overwrite.claim(&args.output, [CLAIMS, PAGE], Inputs::default());
    // The folder of a study protects itself.
    let alone =
        experiments.iter().filter(|experiment| experiment.studies(size).is_ok_and(|studies| studies.is_empty()));
    claim.folders.extend(alone.map(|experiment| experiment.name().to_owned()));
    output_folder::check(&claim)?;
    let backend = args.backend.open()?;
    let folder = OutputFolder::begin(claim)?;
    output::note(&backend.reason);
    let prepare = |experiment| prepare(args, size, experiment, &backend.rasterizer);
    let prepared = experiments.into_iter().map(prepare).collect::<Result<Vec<_>, Failure>>()?;
    let interrupt = Interrupt::listen(Printer::above(None), AT_NEXT_STEP);
    let (mut chapters, count) = (Vec::new(), prepared.len());
    for prepared in &prepared {
        let started = Instant::now();
        let chapter = chapter(prepared, size, &backend.rasterizer, &folder, &interrupt)?;
        let left = match count - chapters.len() - 1 {
            0 => String::new(),
            left => format!("; {} left", counted(left, "experiment")),
        };
        let (experiment, verdicts) = (chapter.experiment, verdicts(&chapter.findings.claims));
        output::note(format_args!("{experiment}: {verdicts}; {:.1} s{left}", started.elapsed().as_secs_f64()));
        chapters.push(chapter);
    }
    let claims = chapters.iter().map(|chapter| (chapter.experiment.name(), chapter.findings.claims.as_slice()));
    folder.write(CLAIMS, claims_csv(claims))?;
    let page = page(&chapters, PageSetting { extent: size, only: args.only, backend: &backend.reason })?;
    folder.write(PAGE, page)?;
    output::note(format_args!(
        "{} in {:.0} s; see {}",
        verdicts(chapters.iter().flat_map(|chapter| &chapter.findings.claims)),
        started.elapsed().as_secs_f64(),
        folder.file(PAGE).display()
    ));
    Ok(())
}

/// Plans the studies of an experiment and makes their folders, in which finished runs are kept.
fn prepare(
    args: &PaperArgs,
    size: ExperimentSize,
    experiment: Experiment,
    rasterizer: &AnyRasterizer,
) -> Result<Prepared, Failure> {
    let safety = Safety { overwrite: args.overwrite.overwrite, ..Safety::default() };
    let mut studies = Vec::new();
    for study in experiment.studies(size)? {
        let path = args.output.join(&study.name);
        let plan = Plan::new(study, &Places::default(), Machine::of(rasterizer))?;
        let folder = StudyFolder::prepare_with(&path, &plan, Existing::Resume, &safety, None)?;
        studies.push((plan, folder));
    }
    Ok(Prepared { experiment, studies })
}

/// Makes an experiment and writes its results.
fn chapter(
    Prepared { experiment, studies }: &Prepared,
    size: ExperimentSize,
    rasterizer: &AnyRasterizer,
    folder: &OutputFolder,
    interrupt: &Interrupt,
) -> Result<Chapter, Failure> {
    let mut chapter = Chapter::new(*experiment);
    if let Some(findings) =
        experiment.run(rasterizer, size, &|what| output::note(format_args!("{experiment}: {what}")))?
    {
        folder.make(experiment.name())?;
        folder.write_findings(&format!("{experiment}/"), &findings)?;
        chapter.findings.add(findings);
    }
    for (plan, of_study) in studies {
        output::note(format_args!("{}: {}", plan.study.name, counted(plan.runs.len(), "run")));
        let display = Display::new(plan, of_study)?;
        let conducted = conduct(plan, &[rasterizer], of_study, &display.stopped_by(interrupt));
        display.printer().clear_bar();
        if conducted? != Conducted::Whole {
            return Err(Failure::interrupted("stopped; the same command goes on"));
        }
        let results = Results::read(plan, of_study)?;
        write_tables(&results, of_study)?;
        let command = format!("gs study {}", plan.study.name);
        report::write(&results, of_study, &command)?;
        chapter.add(&results, report::excerpt(&results, of_study)?);
    }
    Ok(chapter)
}
