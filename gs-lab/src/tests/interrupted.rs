//! Runs of a study that are stopped and go on in another process.

use std::{
    fs,
    path::{Path, PathBuf},
    sync::{
        Arc, Mutex,
        atomic::{AtomicUsize, Ordering},
    },
};

use crate::{
    Existing, Places, Plan, Study, StudyFolder, conduct,
    run::{Conducted, Finished, RunOutcome, Watcher},
    study::{Arm, Run},
};
use gs_density::Policy;
use gs_io::{read_checkpoint, write_checkpoint};
use gs_jobs::WorkSettings;

use super::scenes::{self, cpu, laid_out};

/// Stops after this many steps, and remembers what it was shown.
#[derive(Default)]
struct Stop {
    after: Option<usize>,
    steps: AtomicUsize,
    resumed: Mutex<Vec<(usize, u32)>>,
    warnings: Mutex<Vec<String>>,
}

impl Stop {
    fn after(steps: usize) -> Self {
        Self { after: Some(steps), ..Self::default() }
    }
}

impl Watcher for Stop {
    fn resumed(&self, run: &Run, step: u32) {
        self.resumed.lock().unwrap().push((run.row, step));
    }

    fn warned(&self, run: &Run, message: &str) {
        self.warnings.lock().unwrap().push(format!("row {}: {message}", run.row));
    }

    fn wants_stop(&self) -> bool {
        // Asked once before a run, and once after each step.
        self.after.is_some_and(|after| self.steps.fetch_add(1, Ordering::Relaxed) >= after)
    }
}

/// A run's numbers but for those of the clock.
fn still(folder: &StudyFolder, run: &Run) -> Finished {
    let record = folder.record(run).unwrap().unwrap();
    let RunOutcome::Finished(mut finished) = record.outcome else { panic!("{record:?}") };
    (finished.seconds, finished.backend, finished.side_by_side) = (0.0, String::new(), 1);
    finished.trajectory.iter_mut().for_each(|row| row.seconds = 0.0);
    *finished
}

fn checkpoint_of(folder: &StudyFolder, run: &Run) -> PathBuf {
    folder.file(&format!("runs/{}.safetensors", run.address))
}

fn count(folder: &StudyFolder, ending: &str) -> usize {
    let names = fs::read_dir(folder.file("runs")).unwrap().map(|entry| entry.unwrap().file_name());
    names.filter(|name| name.to_str().unwrap().ends_with(ending)).count()
}

/// Stops each run of a plan after 1, 8, 15, … further steps until it ends, and compares its record
/// with that of an uninterrupted run.
fn check_that_no_stop_changes_a_record(plan: &Plan, alone: &StudyFolder, paused: &StudyFolder) {
    conduct(plan, &[&cpu()], alone, &WorkSettings::default(), &()).unwrap();
    let mut resumed = Vec::new();
    for attempt in 0.. {
        let watcher = Stop::after(2 + 7 * attempt);
        let conducted = conduct(plan, &[&cpu()], paused, &WorkSettings::default(), &watcher).unwrap();
        assert!(watcher.warnings.into_inner().unwrap().is_empty());
        resumed.extend(watcher.resumed.into_inner().unwrap());
        if conducted == Conducted::Whole {
            break;
        }
        assert!(count(paused, ".safetensors") > 0);
    }
    assert!(resumed.len() > 2 && resumed.iter().all(|(_, step)| *step > 0), "{resumed:?}");
    for run in &plan.runs {
        assert_eq!(still(paused, run), still(alone, run), "row {}", run.row);
    }
    assert_eq!(count(paused, ""), plan.runs.len(), "nothing but records is left");
}

#[test]
fn a_stopped_training_resumes_to_the_same_record() {
    let place = scenes::place(1);
    let text = scenes::STUDY.replace("['one', 'two']", "['one']").replace("[0, 1, 2]", "[0]");
    let mut study = Study::from_toml(&text, "x.toml").unwrap();
    let grow = Policy::from_name("percentile").unwrap();
    study.arms.push(Arm::with_policy_3d("own", "grows", Arc::new(grow)));
    let places = Places { data: Some(place.path().to_owned()), ..Places::default() };
    let plan = Plan::new(study, &places, "test").unwrap();
    let [alone, paused] = ["alone", "paused"]
        .map(|name| StudyFolder::prepare(&place.path().join(name), &plan, Existing::Refuse).unwrap());
    check_that_no_stop_changes_a_record(&plan, &alone, &paused);
}

#[test]
fn a_stopped_fit_resumes_to_the_same_record() {
    let place = tempfile::tempdir().unwrap();
    let text = "name = 'x'\nimages = ['paper-64px']\nbudgets = [40]\nseeds = [0]\npreset = 'paper'\niterations = 60\n\
        [settings]\nrounds = { every = 10, from = 10, until = 50 }\n[[arm]]\nname = 'none'\nsettings.policy.kind = 'none'\n\
        [[arm]]\nname = 'grown'\nsettings.policy = { kind = 'percentile', percent = 50 }\n";
    let plan = Plan::new(Study::from_toml(text, "x.toml").unwrap(), &Places::default(), "test").unwrap();
    let [alone, paused] = ["alone", "paused"]
        .map(|name| StudyFolder::prepare(&place.path().join(name), &plan, Existing::Refuse).unwrap());
    check_that_no_stop_changes_a_record(&plan, &alone, &paused);
}

/// The plan of one training in this place.
fn one_training(place: &Path, seed: u32) -> Plan {
    let arms = scenes::STUDY.find("[[arm]]").unwrap();
    let text =
        scenes::STUDY[..arms].replace("['one', 'two']", "['one']") + "[[arm]]\nname = 'grown'\npolicy = 'percentile'\n";
    laid_out(&text.replace("[0, 1, 2]", &format!("[{seed}]")), place).unwrap()
}

/// A folder with a checkpoint of the only run of a plan.
fn paused(path: &Path, plan: &Plan) -> (StudyFolder, PathBuf) {
    let folder = StudyFolder::prepare(path, plan, Existing::Refuse).unwrap();
    assert_eq!(
        conduct(plan, &[&cpu()], &folder, &WorkSettings::default(), &Stop::after(9)).unwrap(),
        Conducted::Stopped
    );
    let file = checkpoint_of(&folder, &plan.runs[0]);
    (folder, file)
}

#[test]
fn a_damaged_or_foreign_checkpoint_is_ignored_with_one_line() {
    let place = scenes::place(1);
    let (plan, other) = (one_training(place.path(), 0), one_training(place.path(), 1));
    let alone = StudyFolder::prepare(&place.path().join("alone"), &plan, Existing::Refuse).unwrap();
    conduct(&plan, &[&cpu()], &alone, &WorkSettings::default(), &()).unwrap();
    let (_, foreign) = paused(&place.path().join("foreign"), &other);
    let (folder, file) = paused(&place.path().join("paused"), &plan);
    let good = fs::read(&file).unwrap();
    let changed = |place: usize| {
        let mut bytes = good.clone();
        bytes[place] ^= 1;
        bytes
    };
    let replaced = |from: &str, to: &str| {
        let start = good.windows(from.len()).position(|window| window == from.as_bytes()).unwrap();
        [&good[..start], to.as_bytes(), &good[start + from.len()..]].concat()
    };
    let mut other_step = read_checkpoint(&file).unwrap();
    let step: u32 = other_step.metadata["step"].parse().unwrap();
    other_step.metadata.insert("step".to_owned(), (step - 1).to_string());
    let written = place.path().join("changed");
    write_checkpoint(&written, &other_step).unwrap();
    for (bytes, expected) in [
        (good[..good.len() - 5].to_vec(), "expected"),
        (good[..4].to_vec(), "expected 8 bytes"),
        (Vec::new(), "expected 8 bytes"),
        (changed(good.len() - 3), "its digest is not that of this run"),
        (fs::read(&written).unwrap(), "its digest is not that of this run"),
        (fs::read(&foreign).unwrap(), "its digest is not that of this run"),
        (replaced("\\\"version\\\":1", "\\\"version\\\":9"), "version 9"),
    ] {
        fs::write(&file, bytes).unwrap();
        let watcher = Stop::after(3);
        conduct(&plan, &[&cpu()], &folder, &WorkSettings::default(), &watcher).unwrap();
        let warnings = watcher.warnings.into_inner().unwrap();
        let [warning] = &warnings[..] else { panic!("{expected}: {warnings:?}") };
        assert!(warning.starts_with("row 1: begins anew, as its checkpoint cannot be used: "), "{warning}");
        assert!(warning.contains(expected) && !warning.contains('\n'), "{warning}");
        assert!(watcher.resumed.into_inner().unwrap().is_empty());
    }
    fs::write(&file, &good).unwrap();
    let watcher = Stop::default();
    assert_eq!(conduct(&plan, &[&cpu()], &folder, &WorkSettings::default(), &watcher).unwrap(), Conducted::Whole);
    assert_eq!((watcher.resumed.into_inner().unwrap().len(), watcher.warnings.into_inner().unwrap().len()), (1, 0));
    assert_eq!(still(&folder, &plan.runs[0]), still(&alone, &plan.runs[0]));
    assert_eq!(count(&folder, ".safetensors"), 0);
}

#[test]
fn a_checkpoint_that_cannot_be_stored_costs_no_result() {
    let place = scenes::place(1);
    let plan = one_training(place.path(), 0);
    let folder = StudyFolder::prepare(&place.path().join("out"), &plan, Existing::Refuse).unwrap();
    // A folder in the way of the file.
    fs::create_dir(checkpoint_of(&folder, &plan.runs[0])).unwrap();
    let watcher = Stop::after(9);
    assert_eq!(conduct(&plan, &[&cpu()], &folder, &WorkSettings::default(), &watcher).unwrap(), Conducted::Stopped);
    let warnings = watcher.warnings.into_inner().unwrap();
    assert_eq!(warnings.len(), 2, "{warnings:?}");
    assert!(
        warnings[1].starts_with("row 1: goes on without a checkpoint, which could not be stored: "),
        "{warnings:?}"
    );
    assert_eq!(conduct(&plan, &[&cpu()], &folder, &WorkSettings::default(), &()).unwrap(), Conducted::Whole);
}
