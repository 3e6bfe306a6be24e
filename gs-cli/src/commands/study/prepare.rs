//! `gs study prepare`: the folder of a study, and what every command about a study begins with.

use std::{
    env,
    path::{Path, PathBuf},
};

use gs_backend::{AnyRasterizer, Chosen};
use gs_lab::{
    Error, Existing, Places, Plan, Study, StudyFolder, built_in,
    run::{Preparation, refuse_unsupported},
    study::Machine,
};

use super::arguments::{HeldStudyArgs, PartArgs, PrepareArgs};
use crate::{
    failure::Failure,
    files::text_file::read_text,
    terminal::output::{self, quoted},
};

/// A study whose folder is made.
pub(super) struct Prepared {
    pub(super) plan: Plan,
    pub(super) folder: StudyFolder,
    pub(super) backends: Vec<Chosen>,
    pub(super) places: Places,
    /// The runs in words.
    pub(super) words: String,
}

/// Makes the folder of a study and says how its runs are done.
pub(super) fn run(args: &PrepareArgs) -> Result<(), Failure> {
    let Prepared { folder, backends, words, .. } = prepare(args, 1)?;
    output::note(&backends[0].reason);
    output::result(format_args!("{words}; do them with gs study work {}", quoted(folder.path())))
}

/// Reads a study, opens its backend as often as there are runs side by side, and makes its folder.
pub(super) fn prepare(args: &PrepareArgs, jobs: usize) -> Result<Prepared, Failure> {
    let name = args.study.as_deref().ok_or_else(|| Failure::usage("no study is named").hint("see gs study --help"))?;
    let (whole, beside) = read(name)?;
    let of = whole.runs();
    let study = whole.select(&args.part.selection())?;
    let output = args.output.clone().unwrap_or_else(|| Path::new("gs-out").join(&study.name));
    let backends = args.backend.open_several(jobs)?;
    let rasterizer = &backends[0].rasterizer;
    let places = places(args.data.as_deref(), beside);
    let plan = Plan::new(study, &places, Machine::of(rasterizer))?;
    refuse_unsupported(&plan, rasterizer)?;
    let existing = if args.resume { Existing::Resume } else { Existing::Refuse };
    if args.resume {
        note_other_origin(&output, &plan);
    }
    let (inputs, overwrite) = (vec![name.to_owned()], args.overwrite.overwrite);
    let folder = StudyFolder::prepare(&output, &plan, Preparation { existing, inputs, overwrite })?;
    let words = plan.summary(of);
    Ok(Prepared { plan, folder, backends, places, words })
}

/// Says that a study is resumed by another version, on another machine or with another image than it
/// began with, so that finished runs have to be done again.
fn note_other_origin(output: &Path, plan: &Plan) {
    let Some(folder) = StudyFolder::open(output, false).ok().filter(|folder| folder.machine().is_some()) else {
        return;
    };
    if let Err(Error::Folder { what, .. }) = folder.check(plan) {
        let place = output.display();
        output::note(format_args!(
            "note: {place}: {what}: results of both are never mixed, so its runs are done again"
        ));
    }
}

/// The study of a file with the file's folder, or a built-in study.
fn read(name: &Path) -> Result<(Study, Option<PathBuf>), Failure> {
    if name.is_file() {
        let text = read_text(name, "name the TOML file of a study")?;
        let study = Study::from_toml(&text, &name.display().to_string())?;
        return Ok((study, name.parent().map(Path::to_owned)));
    }
    let has_folder = name.components().count() > 1 || name.extension().is_some();
    // A folder may have the name of the study whose results it holds.
    let known = name.to_str().filter(|_| !has_folder).map(built_in);
    match known {
        Some(Ok(study)) => Ok((study, None)),
        _ if name.is_dir() => {
            let hint = "name the TOML file of a study; gs study work, status and report take the folder of one";
            Err(Failure::failed("is a folder").at(name.display()).hint(hint))
        }
        Some(Err(unknown)) => Err(unknown.into()),
        None => Err(Failure::failed("there is no such file").at(name.display()).hint("name a study, or its file")),
    }
}

/// The study in a folder, to be planned.
pub(super) struct HeldStudy {
    pub(super) folder: StudyFolder,
    study: Study,
    places: Places,
}

impl HeldStudy {
    /// The plan of its runs on a machine.
    pub(super) fn plan(&self, machine: Machine) -> Result<Plan, Failure> {
        Ok(Plan::new(self.study.clone(), &self.places, machine)?)
    }

    /// The plan of its runs on the machine that it was prepared for, whichever this is.
    pub(super) fn plan_as_prepared(&self) -> Result<Plan, Failure> {
        let plan = self.plan(self.folder.machine().unwrap_or_else(|| String::new().into()))?;
        self.folder.check(&plan)?;
        Ok(plan)
    }
}

/// Reads the study of a command about a folder.
pub(super) fn held(args: &HeldStudyArgs, overwrite: bool) -> Result<HeldStudy, Failure> {
    let folder = StudyFolder::open(&args.folder, overwrite)?;
    let file = folder.study_file();
    let study = Study::from_toml(
        &read_text(&file, "restore the file, or prepare the study in another folder")?,
        &file.display().to_string(),
    )?;
    let places = Places { remembered: folder.images(), ..places(args.data.as_deref(), None) };
    Ok(HeldStudy { folder, study, places })
}

/// Where images and data sets are: in the folder of the flag or the environment, and beside the study.
fn places(data: Option<&Path>, beside: Option<PathBuf>) -> Places {
    let data = data.map(Path::to_owned).or_else(|| env::var_os("GS_DATA").map(PathBuf::from));
    Places { data, beside, ..Places::default() }
}

/// The command with everything that results depend on, including what the environment and this
/// machine have decided.
pub(super) fn command(args: &PrepareArgs, jobs: u16, prepared: &Prepared) -> String {
    let study = args.study.as_deref().map_or_else(String::new, quoted);
    let data = prepared.places.data.as_deref().map_or_else(String::new, |data| format!(" --data {}", quoted(data)));
    let jobs = if jobs > 1 { format!(" --jobs {jobs}") } else { String::new() };
    let threads = args.backend.threads.map_or_else(String::new, |threads| format!(" --threads {threads}"));
    let (part, output) = (part(&args.part), quoted(prepared.folder.path()));
    format!("gs study {study}{part} -o {output}{data}{jobs} {}{threads}", prepared.plan.machine.typed_flags())
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

/// The rasterizers of backends.
pub(super) fn rasterizers(backends: &[Chosen]) -> Vec<&AnyRasterizer> {
    backends.iter().map(|backend| &backend.rasterizer).collect()
}
