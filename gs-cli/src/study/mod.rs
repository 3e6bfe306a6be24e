//! `gs study`: arms compared over images, budgets and seeds.

pub(crate) mod arguments;
mod progress;
mod replay;

use std::{
    env, fs,
    path::{Path, PathBuf},
};

use gs_core::{PlanarScene, Rasterizer};
use gs_study::{
    Conducted, Existing, Places, Plan, Results, Study, StudyFolder, built_in, conduct, report, write_tables,
};

use crate::{
    backend::{Team, TeamTask},
    failure::Failure,
    fit::quoted,
    interrupt::Interrupt,
    output,
    study::{
        arguments::{ConductArgs, StudyAction, StudyArgs},
        progress::Display,
    },
};

/// Conducts a study and writes its tables and its report, or replays one of its rows.
///
/// # Errors
/// Where the study, its images or its folder are not possible, and where Ctrl-C stopped it. Runs that fail are rows of the tables.
pub(crate) fn run(args: &StudyArgs) -> Result<(), Failure> {
    match &args.action {
        Some(StudyAction::Replay(args)) => replay::run(args),
        None => conduct_study(&args.conduct),
    }
}

fn conduct_study(args: &ConductArgs) -> Result<(), Failure> {
    let name = args.study.as_deref().ok_or_else(|| Failure::usage("no study is named").mend("see gs study --help"))?;
    let (study, beside) = read(name)?;
    let output = args.output.clone().unwrap_or_else(|| Path::new("gs-out").join(&study.name));
    let team = Team::start(&args.backend, args.jobs.into())?;
    let plan = Plan::new(study, &places(args.data.as_deref(), beside), team.machine())?;
    let existing = if args.resume { Existing::Resume } else { Existing::Refuse };
    let folder = StudyFolder::prepare(&output, &plan, existing)?;
    output::note(team.reason());
    output::note(format_args!(
        "{}: {} runs ({} arms, {} images, {} budgets, {} seeds), {} side by side, into {}",
        plan.study.name,
        plan.runs.len(),
        plan.study.arms.len(),
        plan.targets.len(),
        plan.study.budgets.len(),
        plan.study.seeds.len(),
        args.jobs,
        output.display()
    ));
    let command = command(args, &output);
    let conducted = team.run(Conduct { plan: &plan, folder: &folder })?;
    if conducted == Conducted::Stopped {
        return Err(Failure::interrupted(format_args!("stopped; to go on: {command} --resume")));
    }
    let results = Results::read(&plan, &folder);
    write_tables(&results, &folder)?;
    report::write(&results, &folder, &command)?;
    conclude(&results, &folder)
}

struct Conduct<'a> {
    plan: &'a Plan,
    folder: &'a StudyFolder,
}

impl TeamTask for Conduct<'_> {
    type Output = Result<Conducted, Failure>;

    fn run<R: Rasterizer<PlanarScene> + Sync>(self, team: &[&R]) -> Self::Output {
        let display = Display::new(self.plan, self.folder);
        let interrupt = Interrupt::listen(display.voice());
        let watched = display.stopped_by(&interrupt);
        let conducted = conduct(self.plan, team, self.folder, &watched);
        watched.clear();
        Ok(conducted?)
    }
}

/// The study in a file, and the file's folder; or that which comes with the program under this name.
fn read(name: &Path) -> Result<(Study, Option<PathBuf>), Failure> {
    if !name.is_file() {
        let has_folder = name.components().count() > 1 || name.extension().is_some();
        return match name.to_str().filter(|_| !has_folder) {
            Some(name) => Ok((built_in(name)?, None)),
            None => Err(Failure::failed("there is no such file").at(name.display()).mend("name a study, or its file")),
        };
    }
    let text = fs::read_to_string(name).map_err(|error| {
        Failure::failed(format_args!("cannot be read: {error}"))
            .at(name.display())
            .mend("name the TOML file of a study")
    })?;
    let study = Study::from_toml(&text, &name.display().to_string())?;
    Ok((study, name.parent().map(Path::to_owned)))
}

/// Where images are: the flag, or the environment; and beside the study.
pub(super) fn places(data: Option<&Path>, beside: Option<PathBuf>) -> Places {
    let data = data.map(Path::to_owned).or_else(|| env::var_os("GS_DATA").map(PathBuf::from));
    Places { data, beside, ..Places::default() }
}

/// The command, without what the results do not depend on.
fn command(args: &ConductArgs, output: &Path) -> String {
    let flag = |name: &str, value: Option<&Path>| value.map_or_else(String::new, |v| format!(" {name} {}", quoted(v)));
    let study = args.study.as_deref().map_or_else(String::new, quoted);
    let jobs = if args.jobs > 1 { format!(" --jobs {}", args.jobs) } else { String::new() };
    let data = flag("--data", args.data.as_deref());
    format!("gs study {study} -o {}{data}{jobs}{}", quoted(output), args.backend.words())
}

fn conclude(results: &Results<'_>, folder: &StudyFolder) -> Result<(), Failure> {
    let failed = results.qualities().iter().map(|quality| quality.failed).sum::<usize>();
    for line in report::headlines(results) {
        output::result(line)?;
    }
    let failures = if failed == 0 { String::new() } else { format!("; {failed} runs failed, see runs.csv") };
    output::note(format_args!("see {}{failures}", folder.file("report.html").display()));
    Ok(())
}
