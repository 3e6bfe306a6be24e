//! Policies of one's own: one that fails, and one that equals a policy of the program.

use std::{fs, sync::Arc};

use crate::{
    Existing, Plan, Results, Study, StudyFolder, conduct, report,
    result::{Metric, write_tables},
    study::{Arm, Matching},
};
use gs_core::{EditPlan, Error as CoreError, Gaussian2d};
use gs_density::{DensityPolicy, Observation, Rng};
use gs_jobs::WorkSettings;

use super::{Counter, conducted, cpu, laid_out, place, study};

/// Fails at small budgets by an error, at others by a panic.
struct Moody;

impl DensityPolicy for Moody {
    fn plan(&self, seen: &Observation<'_>, _: &mut Rng) -> Result<EditPlan<Gaussian2d>, CoreError> {
        match seen.budget {
            30 => Err(CoreError::State("not today".to_owned())),
            _ => panic!("not at all"),
        }
    }
}

#[test]
fn a_run_that_fails_is_recorded_and_does_not_stop_the_others() {
    let place = place();
    let mut with_moods = study();
    with_moods.arms.insert(1, Arm::with_policy("moody", "fails always", Arc::new(Moody)));
    let plan = laid_out(with_moods, place.path());
    let folder = StudyFolder::prepare(&place.path().join("out"), &plan, Existing::Refuse).unwrap();
    let counter = Counter::default();
    conduct(&plan, &[&cpu(1), &cpu(1)], &folder, &WorkSettings::default(), &counter).unwrap();
    assert_eq!(counter.failed.lock().unwrap().len(), 8);
    let results = Results::read(&plan, &folder).unwrap();
    write_tables(&results, &folder).unwrap();
    report::write(&results, &folder, "gs study").unwrap();
    let runs = fs::read_to_string(folder.file("runs.csv")).unwrap();
    assert_eq!(runs.matches(",failed,").count(), 8);
    assert_eq!(runs.matches("not today").count(), 4);
    assert_eq!(runs.matches("panicked: not at all").count(), 4);
    assert_eq!(runs.matches(",finished,").count(), 16);
    let page = fs::read_to_string(folder.file("report.html")).unwrap();
    assert!(page.contains("Runs that failed") && page.contains("not today"));
    let headlines = report::headlines(&results);
    assert!(
        headlines
            .iter()
            .all(|line| line.contains("; no verdict on moody, because there is no pair of finished runs on ")),
        "{headlines:?}"
    );
    // The other arms are compared as if it did not exist.
    let difference = results.difference(Matching::Iterations, Metric::Psnr, 60, 2, 0);
    assert_eq!((difference.pairs, results.difference(Matching::Count, Metric::Psnr, 60, 1, 0).pairs), (2, 0));
    // Failed runs are tried again when the study is resumed, and not before.
    let begun = |folder: &StudyFolder| {
        let again = Counter::default();
        conduct(&plan, &[&cpu(1)], folder, &WorkSettings::default(), &again).unwrap();
        again.begun.into_inner()
    };
    assert_eq!(begun(&folder), 0);
    assert_eq!(begun(&StudyFolder::prepare(folder.path(), &plan, Existing::Resume).unwrap()), 8);
}

#[test]
fn a_policy_of_ones_own_takes_part_under_its_fingerprint() {
    let place = place();
    let same = |fingerprint: &str| {
        let mut study = study();
        let policy = gs_density::Policy::from_name("none").unwrap();
        study.arms.push(Arm::with_policy("own", fingerprint, Arc::new(policy)));
        laid_out(study, place.path())
    };
    let (plan, other) = (same("own 1"), same("own 2"));
    let addresses = |plan: &Plan| plan.runs.iter().map(|run| run.address.clone()).collect::<Vec<_>>();
    let changed = addresses(&plan).iter().zip(addresses(&other)).filter(|(a, b)| **a != *b).count();
    assert_eq!(changed, plan.runs.len() / 3, "those of the arm with another policy, and no others");
    let folder = conducted(&plan, &place.path().join("out"), 1, 1);
    let results = Results::read(&plan, &folder).unwrap();
    // The custom policy has the results of the arm `none`, to the bit.
    let scenes = |arm: usize| results.finished(arm, 60).map(|(_, end)| end.scene.clone()).collect::<Vec<_>>();
    assert_eq!(scenes(2), scenes(0));
    assert_ne!(scenes(1), scenes(0));
    // A program that reads the study's file finds the same runs, but cannot do them.
    let file = fs::read_to_string(folder.study_file()).unwrap();
    let read = laid_out(Study::from_toml(&file, "study.toml").unwrap(), place.path());
    assert_eq!(addresses(&read), addresses(&plan));
    let message = conduct(&read, &[&cpu(1)], &folder, &WorkSettings::default(), &()).unwrap_err().to_string();
    assert!(message.contains("`own`: its policy is code that this program does not have"), "{message}");
}
