//! Which runs a process does, and that tables do not depend on who did them.

use std::{fs, thread};

use crate::{
    Error, Existing, Results, StudyFolder, conduct, result::write_tables, run::Conducted, study::digest::of_scene,
};
use gs_jobs::{Shard, WorkSettings};
use gs_train::fit;
use pollster::FutureExt as _;

use super::{Counter, conducted, cpu, laid_out, place, record, study, tables};

#[test]
fn tables_depend_neither_on_jobs_nor_on_threads_nor_on_a_pause() {
    let place = place();
    let plan = laid_out(study(), place.path());
    let alone = conducted(&plan, &place.path().join("alone"), 1, 2);
    let side_by_side = conducted(&plan, &place.path().join("side-by-side"), 3, 1);
    assert_eq!(tables(&alone), tables(&side_by_side));

    let paused = StudyFolder::prepare(&place.path().join("paused"), &plan, Existing::Refuse).unwrap();
    let counter = Counter { stop_after: Some(5), ..Counter::default() };
    assert_eq!(conduct(&plan, &[&cpu(1)], &paused, &WorkSettings::default(), &counter).unwrap(), Conducted::Stopped);
    drop(paused);
    let paused = place.path().join("paused");
    assert!(matches!(StudyFolder::prepare(&paused, &plan, Existing::Refuse), Err(Error::Folder { .. })));
    assert_eq!(tables(&alone), tables(&conducted(&plan, &paused, 1, 1)));
}

#[test]
fn every_row_is_a_fit_that_ends_in_the_recorded_scene() {
    let place = place();
    let plan = laid_out(study(), place.path());
    let folder = conducted(&plan, &place.path().join("out"), 2, 1);
    for run in [&plan.runs[0], &plan.runs[3], &plan.runs[plan.runs.len() - 1]] {
        let record = folder.record(run).unwrap().unwrap();
        let (image, settings) = (plan.target(run).image().unwrap(), run.settings.of_image());
        let as_fit = fit(&cpu(2), image, settings.clone(), &mut ()).block_on().unwrap();
        assert_eq!(of_scene(&as_fit.scene), record.outcome.finished().unwrap().scene);
    }
}

#[test]
fn finished_runs_are_not_repeated_and_new_ones_are_done() {
    let place = place();
    let output = place.path().join("out");
    let plan = laid_out(study(), place.path());
    let folder = conducted(&plan, &output, 1, 1);
    let again = Counter::default();
    conduct(&plan, &[&cpu(1)], &folder, &WorkSettings::default(), &again).unwrap();
    assert_eq!(again.begun.into_inner(), 0);
    drop(folder);

    let mut longer = study();
    longer.seeds.push(7);
    let plan = laid_out(longer, place.path());
    // A truncated file counts as missing.
    fs::write(record(&output, &plan, 3), "{\"address\": ").unwrap();
    let folder = StudyFolder::prepare(&output, &plan, Existing::Resume).unwrap();
    let counter = Counter::default();
    conduct(&plan, &[&cpu(1)], &folder, &WorkSettings::default(), &counter).unwrap();
    assert_eq!(counter.begun.into_inner(), 8 + 1);
}

#[test]
fn processes_share_the_runs_of_a_folder() {
    let place = place();
    let plan = laid_out(study(), place.path());
    let whole = conducted(&plan, &place.path().join("whole"), 1, 1);
    let shared = StudyFolder::prepare(&place.path().join("shared"), &plan, Existing::Refuse).unwrap();
    let counters: Vec<Counter> = (0..3).map(|_| Counter::default()).collect();
    thread::scope(|scope| {
        for (index, counter) in counters.iter().enumerate() {
            let (plan, path) = (&plan, shared.path());
            scope.spawn(move || {
                let shard = index.checked_sub(1).map(|index| Shard { index: index as u32, count: 2 });
                let settings = WorkSettings::default().with(|s| s.shard = shard);
                let folder = StudyFolder::open(path, false).unwrap();
                assert_eq!(conduct(plan, &[&cpu(1)], &folder, &settings, counter).unwrap(), Conducted::Whole);
            });
        }
    });
    let begun: Vec<usize> = counters.into_iter().map(|counter| counter.begun.into_inner()).collect();
    assert_eq!(begun.iter().sum::<usize>(), plan.runs.len(), "{begun:?}");
    write_tables(&Results::read(&plan, &shared).unwrap(), &shared).unwrap();
    assert_eq!(tables(&shared), tables(&whole));
}
