//! `gs study`: compares arms over images, budgets and seeds.

mod arguments;
mod progress;
mod replay;

use std::{
    env,
    path::{Path, PathBuf},
};

use gs_backend::AnyRasterizer;
use gs_core::counted;
use gs_lab::{
    Existing, Places, Plan, Results, Study, StudyFolder, built_in, conduct, report,
    study::{Conducted, RunOutcome, Safety, refuse_unsupported, write_tables},
};

pub(crate) use self::arguments::StudyArgs;
use self::{
    arguments::{ConductArgs, PartArgs, StudyAction},
    progress::Display,
};
use crate::{
    backend::machine,
    failure::Failure,
    interrupt::Interrupt,
    output::{self, quoted},
    text_file::read_text,
};

/// Conducts a study and writes its tables and its report, or replays one of its rows.
pub(crate) fn run(args: &StudyArgs) -> Result<(), Failure> {
    match &args.action {
        Some(StudyAction::Replay(args)) => replay::run(args),
        None => conduct_study(&args.conduct),
    }
}

fn conduct_study(args: &ConductArgs) -> Result<(), Failure> {
    let name = args.study.as_deref().ok_or_else(|| Failure::usage("no study is named").hint("see gs study --help"))?;
    let (whole, beside) = read(name)?;
    let of = whole.runs();
    let study = whole.select(&args.part.selection())?;
    let output = args.output.clone().unwrap_or_else(|| Path::new("gs-out").join(&study.name));
    let backends = args.backend.open_several(args.jobs.into())?;
    let rasterizers: Vec<&AnyRasterizer> = backends.iter().map(|backend| &backend.rasterizer).collect();
    let places = places(args.data.as_deref(), beside);
    let plan = Plan::new(study, &places, machine(rasterizers[0]))?;
    refuse_unsupported(&plan, rasterizers[0])?;
    let existing = if args.resume { Existing::Resume } else { Existing::Refuse };
    let safety = Safety { inputs: vec![name.to_owned()], overwrite: args.overwrite.overwrite };
    let folder = StudyFolder::prepare_with(&output, &plan, existing, &safety)?;
    output::note(&backends[0].reason);
    output::note(format_args!(
        "{}: {} ({}, {}, {}, {}), {} side by side, into {}",
        plan.study.name,
        match plan.runs.len() {
            all if all == of => counted(all, "run"),
            part => format!("{part} of {}", counted(of, "run")),
        },
        counted(plan.study.arms.len(), "arm"),
        counted(plan.targets.len(), plan.study.target_word()),
        counted(plan.study.budgets.len(), "budget"),
        counted(plan.study.seeds.len(), "seed"),
        args.jobs,
        output.display()
    ));
    let command = command(args, &plan, &places, &output);
    let display = Display::new(&plan, &folder);
    let interrupt = Interrupt::listen(display.printer());
    let conducted = conduct(&plan, &rasterizers, &folder, &display.stopped_by(&interrupt));
    display.printer().clear_bar();
    if conducted? == Conducted::Stopped {
        return Err(Failure::interrupted(format_args!("stopped; to go on: {command} --resume")));
    }
    let results = Results::read(&plan, &folder);
    write_tables(&results, &folder)?;
    report::write(&results, &folder, &command)?;
    conclude(&results, &folder)
}

/// The study of a file with the file's folder, or a built-in study.
fn read(name: &Path) -> Result<(Study, Option<PathBuf>), Failure> {
    if name.is_dir() {
        let hint = "name the TOML file of a study; gs study replay takes the folder of one";
        return Err(Failure::failed("is a folder").at(name.display()).hint(hint));
    }
    if !name.is_file() {
        let has_folder = name.components().count() > 1 || name.extension().is_some();
        return match name.to_str().filter(|_| !has_folder) {
            Some(name) => Ok((built_in(name)?, None)),
            None => Err(Failure::failed("there is no such file").at(name.display()).hint("name a study, or its file")),
        };
    }
    let text = read_text(name, "name the TOML file of a study")?;
    let study = Study::from_toml(&text, &name.display().to_string())?;
    Ok((study, name.parent().map(Path::to_owned)))
}

/// Where images and data sets are: in the folder of the flag or the environment, and beside the study.
pub(super) fn places(data: Option<&Path>, beside: Option<PathBuf>) -> Places {
    let data = data.map(Path::to_owned).or_else(|| env::var_os("GS_DATA").map(PathBuf::from));
    Places { data, beside, ..Places::default() }
}

/// The command with everything that results depend on, including what the environment and this
/// machine have decided.
fn command(args: &ConductArgs, plan: &Plan, places: &Places, output: &Path) -> String {
    let study = args.study.as_deref().map_or_else(String::new, quoted);
    let data = places.data.as_deref().map_or_else(String::new, |data| format!(" --data {}", quoted(data)));
    let jobs = if args.jobs > 1 { format!(" --jobs {}", args.jobs) } else { String::new() };
    let threads = args.backend.threads.map_or_else(String::new, |threads| format!(" --threads {threads}"));
    let part = part(&args.part);
    format!("gs study {study}{part} -o {}{data}{jobs} {}{threads}", quoted(output), plan.machine.typed_flags())
}

/// The flags that name a part of the study.
fn part(PartArgs { images, scenes, budgets, seeds, arms }: &PartArgs) -> String {
    let numbers = |numbers: &[u32]| numbers.iter().map(ToString::to_string).collect::<Vec<_>>();
    let lists = [
        ("images", images.clone()),
        ("scenes", scenes.clone()),
        ("budgets", numbers(budgets)),
        ("seeds", numbers(seeds)),
        ("arms", arms.clone()),
    ];
    let given = lists.into_iter().filter(|(_, list)| !list.is_empty());
    given.map(|(flag, list)| format!(" --{flag} {}", quoted(Path::new(&list.join(","))))).collect()
}

/// Prints the results of the study.
fn conclude(results: &Results<'_>, folder: &StudyFolder) -> Result<(), Failure> {
    let failed: Vec<&str> = results
        .records
        .iter()
        .flatten()
        .filter_map(|record| match &record.outcome {
            RunOutcome::Failed { error } => Some(error.as_str()),
            RunOutcome::Finished(_) => None,
        })
        .collect();
    if let Some(first) = failed.first().filter(|_| failed.len() == results.plan.runs.len()) {
        let table = folder.file("runs.csv");
        let all = counted(failed.len(), "run");
        return Err(Failure::failed(format_args!("all {all} failed, the first since {first}"))
            .at(&results.plan.study.name)
            .hint(format_args!("see {}", table.display())));
    }
    for line in report::headlines(results) {
        output::result(line)?;
    }
    let failures = if failed.is_empty() {
        String::new()
    } else {
        format!("; {} failed, see runs.csv", counted(failed.len(), "run"))
    };
    output::note(format_args!("see {}{failures}", folder.file("report.html").display()));
    Ok(())
}
