//! Records that are damaged, done twice, or cannot be stored.

use std::{fs, path::Path};

use crate::{
    Existing, Plan, Results, StudyFolder, conduct,
    result::write_tables,
    run::{Conducted, Watcher},
    study::Run,
};
use gs_jobs::WorkSettings;

use super::{Counter, conducted, cpu, laid_out, place, record, study, tables};

#[test]
fn damaged_records_are_no_rows_and_their_runs_are_done_again() {
    let place = place();
    let plan = laid_out(study(), place.path());
    let folder = conducted(&plan, &place.path().join("out"), 1, 1);
    let whole = tables(&folder);
    let file = |row| record(folder.path(), &plan, row);
    let text = fs::read(file(2)).unwrap();
    fs::write(file(2), &text[..text.len() / 2]).unwrap();
    fs::write(file(5), "").unwrap();
    fs::copy(file(7), file(6)).unwrap();
    let results = Results::read(&plan, &folder).unwrap();
    assert_eq!(results.records.iter().flatten().count(), plan.runs.len() - 3);
    assert_eq!(folder.remove_damaged(results.missing()).unwrap(), [2, 5, 6]);
    let counter = Counter::default();
    conduct(&plan, &[&cpu(1)], &folder, &WorkSettings::default(), &counter).unwrap();
    assert_eq!(counter.begun.into_inner(), 3);
    write_tables(&Results::read(&plan, &folder).unwrap(), &folder).unwrap();
    assert_eq!(tables(&folder), whole);
}

/// Finishes a run as another process would, with another result, while it is under way.
struct Meddler<'a> {
    folder: &'a Path,
    plan: &'a Plan,
    changed: (&'a str, &'a str),
}

impl Watcher for Meddler<'_> {
    fn begun(&self, run: &Run) {
        let whole =
            fs::read_to_string(self.folder.with_file_name("whole").join("runs").join(format!("{}.json", run.address)));
        let (from, to) = self.changed;
        fs::write(record(self.folder, self.plan, run.row), whole.unwrap().replace(from, to)).unwrap();
    }
}

#[test]
fn a_run_done_twice_must_have_one_result_and_the_first_record_stays() {
    let place = place();
    let plan = laid_out(study(), place.path());
    drop(conducted(&plan, &place.path().join("whole"), 1, 2));
    let meddled = |name: &str, changed| {
        let folder = StudyFolder::prepare(&place.path().join(name), &plan, Existing::Refuse).unwrap();
        let conducted = conduct(
            &plan,
            &[&cpu(1)],
            &folder,
            &WorkSettings::default(),
            &Meddler { folder: folder.path(), plan: &plan, changed },
        );
        (conducted, fs::read_to_string(record(folder.path(), &plan, 1)).unwrap())
    };
    let (same, kept) = meddled("same", ("\"seconds\":", "\"seconds\":1"));
    assert_eq!(same.unwrap(), Conducted::Whole);
    assert!(kept.contains("\"seconds\":1"), "the first");
    let (other, kept) = meddled("other", ("\"scene\":\"", "\"scene\":\"f00d"));
    let line = other.unwrap_err().to_string();
    assert!(
        line.starts_with("row 1 (none, paper, 30 Gaussians, seed 0): was computed twice, with different results"),
        "{line}"
    );
    assert!(line.contains("instead of f00d") && kept.contains("f00d"), "{line}");
}

#[test]
fn a_failed_store_ends_the_work_and_releases_the_run() {
    let place = place();
    let plan = laid_out(study(), place.path());
    let folder = StudyFolder::prepare(&place.path().join("out"), &plan, Existing::Refuse).unwrap();
    // Pictures of the first seed cannot be stored.
    fs::remove_dir(folder.file("pictures")).unwrap();
    let line = conduct(&plan, &[&cpu(1)], &folder, &WorkSettings::default(), &()).unwrap_err().to_string();
    assert!(line.contains("cannot be written: there is no folder "), "{line}");
    assert!(folder.running(&plan).unwrap().iter().all(Option::is_none), "given back");
    fs::create_dir(folder.file("pictures")).unwrap();
    assert_eq!(conduct(&plan, &[&cpu(1)], &folder, &WorkSettings::default(), &()).unwrap(), Conducted::Whole);
    let names: Vec<_> = fs::read_dir(folder.file("runs")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names.len(), plan.runs.len(), "{names:?}");
}
