//! `gs study`: compares arms over images, budgets and seeds, in one process or on a cluster.

mod arguments;
mod prepare;
mod progress;
mod report;
mod status;
mod submit;
mod work;

use gs_core::counted;
use gs_jobs::WorkSettings;
use gs_lab::{Results, StudyFolder, conduct, run::Conducted};

pub(crate) use self::{arguments::StudyArgs, progress::Display};
use self::{
    arguments::{ConductArgs, StudyAction},
    prepare::{command, prepare, rasterizers},
};
use crate::{
    failure::Failure,
    terminal::{
        interrupt::{AT_NEXT_STEP, Interrupt},
        output,
    },
};

/// Conducts a study and writes its tables and its report, or does another thing with a study.
pub(crate) fn run(args: &StudyArgs) -> Result<(), Failure> {
    match &args.action {
        Some(StudyAction::Prepare(args)) => prepare::run(args),
        Some(StudyAction::Work(args)) => work::run(args),
        Some(StudyAction::Submit(args)) => submit::run(args),
        Some(StudyAction::Status(args)) => status::run(args),
        Some(StudyAction::Report(args)) => report::run(args),
        None => conduct_study(&args.conduct),
    }
}

fn conduct_study(args: &ConductArgs) -> Result<(), Failure> {
    let prepared = prepare(&args.study, args.jobs.into())?;
    let command = command(&args.study, args.jobs, &prepared);
    let prepare::Prepared { plan, folder, backends, words, .. } = prepared;
    output::note(&backends[0].reason);
    output::note(format_args!("{words}, {} side by side, into {}", args.jobs, folder.path().display()));
    let display = Display::new(&plan, &folder)?;
    let interrupt = Interrupt::listen(display.printer(), AT_NEXT_STEP);
    let team = rasterizers(&backends);
    let results = loop {
        let conducted = conduct(&plan, &team, &folder, &WorkSettings::default(), &display.stopped_by(&interrupt));
        display.printer().clear_bar();
        if conducted? != Conducted::Whole {
            return Err(Failure::interrupted(format_args!("stopped; to go on: {command} --resume")));
        }
        let results = Results::read(&plan, &folder)?;
        if report::remove_damaged(&results, &folder)? == 0 {
            break results;
        }
    };
    gs_lab::report::write(&results, &folder, &command)?;
    conclude(&results, &folder)
}

/// Prints the results of the study.
fn conclude(results: &Results<'_>, folder: &StudyFolder) -> Result<(), Failure> {
    let failed = results.failures();
    if let Some(first) = failed.first().filter(|_| failed.len() == results.plan.runs.len()) {
        let table = folder.file("runs.csv");
        let all = counted(failed.len(), "run");
        return Err(Failure::failed(format_args!("all {all} failed, the first since {first}"))
            .at(&results.plan.study.name)
            .hint(format_args!("see {}", table.display())));
    }
    for line in gs_lab::report::headlines(results) {
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
