//! Studies of images from end to end: which runs are stored and resumed, and what the tables
//! contain.

mod damage;
mod folders;
mod own_policies;
mod results;
mod running;

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    sync::{
        Mutex,
        atomic::{AtomicBool, AtomicUsize, Ordering},
    },
};

use crate::{
    Existing, Places, Plan, Results, Study, StudyFolder, conduct, report,
    result::write_tables,
    run::{Conducted, RunOutcome, Watcher},
    study::Run,
};
use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_jobs::WorkSettings;

const STUDY: &str = "name = 'small'\nquestion = 'Does growth help?'\nimages = ['paper', 'stripes.png']\nbudgets = [30, 60]\nseeds = [0, 1]\n\
    preset = 'paper'\niterations = 30\n[settings]\nrounds = { every = 5, from = 5, until = 25 }\n\
    [[arm]]\nname = 'none'\nsettings.policy.kind = 'none'\n\
    [[arm]]\nname = 'percentile'\nsettings.policy = { kind = 'percentile', percent = 50 }\n";

fn cpu(threads: usize) -> CpuRasterizer {
    CpuRasterizer::new(CpuSettings::default().with(|s| {
        s.threads = Some(threads);
        s.level = None;
    }))
    .unwrap()
}

/// A folder with an image for the study.
fn place() -> tempfile::TempDir {
    let place = tempfile::tempdir().unwrap();
    let stripes =
        gs_core::Image::from_fn(48, 40, |x, y| [if x / 6 % 2 == 0 { 0.9 } else { 0.1 }, y as f32 / 40.0, 0.5]);
    gs_io::write_png(place.path().join("stripes.png"), &stripes.unwrap()).unwrap();
    place
}

fn laid_out(study: Study, place: &Path) -> Plan {
    let places = Places { data: Some(place.to_owned()), ..Places::default() };
    Plan::new(study, &places, "test").unwrap()
}

fn study() -> Study {
    Study::from_toml(STUDY, "small.toml").unwrap()
}

/// Conducts a plan and writes tables and report.
fn conducted(plan: &Plan, output: &Path, jobs: usize, threads: usize) -> StudyFolder {
    let folder = StudyFolder::prepare(output, plan, Existing::Resume).unwrap();
    let team: Vec<CpuRasterizer> = (0..jobs).map(|_| cpu(threads)).collect();
    let done = conduct(plan, &team.iter().collect::<Vec<_>>(), &folder, &WorkSettings::default(), &()).unwrap();
    assert_eq!(done, Conducted::Whole);
    let results = Results::read(plan, &folder).unwrap();
    assert_eq!(results.missing().count(), 0);
    write_tables(&results, &folder).unwrap();
    report::write(&results, &folder, "gs study small.toml").unwrap();
    folder
}

/// The tables that do not depend on measured time.
fn tables(folder: &StudyFolder) -> BTreeMap<&'static str, String> {
    let names = ["runs.csv", "quality.csv", "differences.csv"];
    names.map(|name| (name, fs::read_to_string(folder.file(name)).unwrap())).into()
}

/// Counts runs, and stops the study after some.
#[derive(Default)]
struct Counter {
    begun: AtomicUsize,
    failed: Mutex<Vec<usize>>,
    stop_after: Option<usize>,
    stop: AtomicBool,
}

impl Watcher for Counter {
    fn begun(&self, _: &Run) {
        self.begun.fetch_add(1, Ordering::Relaxed);
    }

    fn ended(&self, run: &Run, outcome: &RunOutcome) {
        if matches!(outcome, RunOutcome::Failed { .. }) {
            self.failed.lock().unwrap().push(run.row);
        }
        if self.stop_after.is_some_and(|most| self.begun.load(Ordering::Relaxed) >= most) {
            self.stop.store(true, Ordering::Relaxed);
        }
    }

    fn wants_stop(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// The file of a row's record.
fn record(output: &Path, plan: &Plan, row: usize) -> PathBuf {
    output.join("runs").join(format!("{}.json", plan.runs[row - 1].address))
}
