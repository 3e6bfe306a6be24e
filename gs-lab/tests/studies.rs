//! Studies from end to end: which runs are stored, resumed and replayed, and what the tables
//! contain.

use pollster::FutureExt as _;
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, AtomicUsize, Ordering},
    },
    thread,
};

use gs_core::{EditPlan, Error as CoreError, Gaussian2d, effects::Statistics};
use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_density::{DensityPolicy, Observation, Rng};
use gs_lab::{
    Error, Existing, Places, Plan, Results, Study, StudyFolder, conduct, conduct_with, report,
    study::{
        AnyScene, Arm, Conducted, Machine, Matching, Metric, ResultRemark, Run, RunOutcome, Safety, Shard, VERSION,
        Verdict, Watcher, WorkSettings, replay, scene_digest, write_tables,
    },
};
use gs_train::fit;

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
    let done = conduct(plan, &team.iter().collect::<Vec<_>>(), &folder, &()).unwrap();
    assert_eq!(done, Conducted::Whole);
    let results = Results::read(plan, &folder).unwrap();
    assert!(results.is_whole());
    write_tables(&results, &folder).unwrap();
    report::write(&results, &folder, "gs study small.toml").unwrap();
    folder
}

/// The tables that do not depend on measured time.
fn tables(folder: &StudyFolder) -> BTreeMap<&'static str, String> {
    let names = ["runs.csv", "quality.csv", "differences.csv", "results.json"];
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

#[test]
fn tables_depend_neither_on_jobs_nor_on_threads_nor_on_a_pause() {
    let place = place();
    let plan = laid_out(study(), place.path());
    let alone = conducted(&plan, &place.path().join("alone"), 1, 2);
    let side_by_side = conducted(&plan, &place.path().join("side-by-side"), 3, 1);
    assert_eq!(tables(&alone), tables(&side_by_side));

    let paused = StudyFolder::prepare(&place.path().join("paused"), &plan, Existing::Refuse).unwrap();
    let counter = Counter { stop_after: Some(5), ..Counter::default() };
    assert_eq!(conduct(&plan, &[&cpu(1)], &paused, &counter).unwrap(), Conducted::Stopped);
    drop(paused);
    let paused = place.path().join("paused");
    assert!(matches!(StudyFolder::prepare(&paused, &plan, Existing::Refuse), Err(Error::Folder { .. })));
    assert_eq!(tables(&alone), tables(&conducted(&plan, &paused, 1, 1)));
}

#[test]
fn what_is_finished_is_not_done_again_and_what_is_new_is() {
    let place = place();
    let output = place.path().join("out");
    let plan = laid_out(study(), place.path());
    let folder = conducted(&plan, &output, 1, 1);
    let again = Counter::default();
    conduct(&plan, &[&cpu(1)], &folder, &again).unwrap();
    assert_eq!(again.begun.into_inner(), 0);
    drop(folder);

    let mut longer = study();
    longer.seeds.push(7);
    let plan = laid_out(longer, place.path());
    // A truncated file counts as missing.
    fs::write(record(&output, &plan, 3), "{\"address\": ").unwrap();
    let folder = StudyFolder::prepare(&output, &plan, Existing::Resume).unwrap();
    let counter = Counter::default();
    conduct(&plan, &[&cpu(1)], &folder, &counter).unwrap();
    assert_eq!(counter.begun.into_inner(), 8 + 1);
}

#[test]
fn every_row_is_a_fit_that_ends_in_the_recorded_scene() {
    let place = place();
    let plan = laid_out(study(), place.path());
    let folder = conducted(&plan, &place.path().join("out"), 2, 1);
    let (rasterizer, other) = (cpu(1), cpu(2));
    for row in [1, 4, plan.runs.len()] {
        let replayed = replay(&plan, row, &rasterizer, &folder).unwrap();
        let run = plan.run(row).unwrap();
        let (image, settings) = (plan.target(run).image().unwrap(), run.settings.of_image().unwrap());
        let as_fit = fit(&other, image, settings.clone(), &mut ()).block_on().unwrap();
        assert_eq!(replayed.scene, AnyScene::In2d(as_fit.scene.clone()));
        assert_eq!(scene_digest(&as_fit.scene), replayed.finished.scene);
    }
    // The tables suffice.
    fs::remove_dir_all(folder.file("runs")).unwrap();
    replay(&plan, 2, &rasterizer, &folder).unwrap();
    assert!(matches!(replay(&plan, 99, &rasterizer, &folder), Err(Error::NoRow { row: 99, rows: 16 })));
    // A row of another machine is refused, and so is a scene other than the recorded one.
    let places = Places { data: Some(place.path().to_owned()), ..Places::default() };
    let elsewhere = Plan::new(study(), &places, "another machine").unwrap();
    let refused = replay(&elsewhere, 2, &rasterizer, &folder).unwrap_err().to_string();
    assert_eq!(refused, "row 2: recorded on test, but this is another machine: replay it there");
    let other_settings = laid_out(study().with(|s| s.iterations = Some(31)), place.path());
    assert!(matches!(replay(&other_settings, 2, &rasterizer, &folder), Err(Error::OtherRun { row: 2, .. })));
    let json = fs::read_to_string(folder.file("results.json")).unwrap();
    let scene = replay(&plan, 2, &rasterizer, &folder).unwrap().finished.scene;
    fs::write(folder.file("results.json"), json.replace(&scene, "0123")).unwrap();
    let refused = replay(&plan, 2, &rasterizer, &folder).unwrap_err().to_string();
    assert!(refused.contains("not the recorded one") && refused.contains("0123"), "{refused}");
}

#[test]
fn a_row_of_another_machine_or_version_says_so_and_how_to_get_there() {
    let place = place();
    let plan = laid_out(study(), place.path());
    let flags = ["--backend", "wgpu", "--adapter", "some GPU"].map(str::to_owned).to_vec();
    let there = Plan { machine: Machine { name: "wgpu some GPU".to_owned(), flags }, ..plan.clone() };
    let output = place.path().join("out");
    drop(conducted(&there, &output, 1, 1));
    let folder = StudyFolder::open(&output).unwrap();
    let refused = replay(&plan, 1, &cpu(1), &folder).unwrap_err().to_string();
    let expected = "row 1: recorded on wgpu some GPU, but this is test: add --backend wgpu --adapter 'some GPU'";
    assert_eq!(refused, expected);
    // The tables alone give the same error.
    fs::remove_dir_all(folder.file("runs")).unwrap();
    fs::remove_file(folder.file("machine.json")).unwrap();
    let mut moved = plan.clone();
    moved.runs[0].address = "0".to_owned();
    assert_eq!(replay(&moved, 1, &cpu(1), &folder).unwrap_err().to_string(), expected);
    let json = fs::read_to_string(folder.file("results.json")).unwrap();
    let older = json.replace(&format!("\"version\":\"{}\"", VERSION), "\"version\":\"0.0.9\"");
    fs::write(folder.file("results.json"), older.replace("wgpu some GPU", "test")).unwrap();
    let refused = replay(&moved, 1, &cpu(1), &folder).unwrap_err().to_string();
    assert!(refused.starts_with("row 1: recorded by version 0.0.9, but this is 0."), "{refused}");
}

/// The file of a row's record.
fn record(output: &Path, plan: &Plan, row: usize) -> PathBuf {
    output.join("runs").join(format!("{}.json", plan.run(row).unwrap().address))
}

#[test]
fn a_folder_is_for_one_study() {
    let place = place();
    let output = place.path().join("out");
    let plan = laid_out(study(), place.path());
    let folder = StudyFolder::prepare(&output, &plan, Existing::Refuse).unwrap();
    let before = fs::read_to_string(output.join("study.toml")).unwrap();
    let other = laid_out(study().with(|s| s.name = "other".to_owned()), place.path());
    let taken = StudyFolder::prepare(&output, &other, Existing::Resume).unwrap_err().to_string();
    assert!(taken.contains("holds another study than `other`: `small`: choose another folder"), "{taken}");
    assert_eq!(fs::read_to_string(output.join("study.toml")).unwrap(), before);
    // Another process may resume it while this one has it.
    StudyFolder::prepare(&output, &plan, Existing::Resume).unwrap().check(&plan).unwrap();
    drop(folder);
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
                let folder = StudyFolder::open(path).unwrap();
                assert_eq!(conduct_with(plan, &[&cpu(1)], &folder, &settings, counter).unwrap(), Conducted::Whole);
            });
        }
    });
    let begun: Vec<usize> = counters.into_iter().map(|counter| counter.begun.into_inner()).collect();
    assert_eq!(begun.iter().sum::<usize>(), plan.runs.len(), "{begun:?}");
    write_tables(&Results::read(&plan, &shared).unwrap(), &shared).unwrap();
    assert_eq!(tables(&shared), tables(&whole));
}

#[test]
fn a_folder_prepared_for_something_else_is_refused() {
    let place = place();
    let output = place.path().join("out");
    let plan = laid_out(study(), place.path());
    let folder = StudyFolder::prepare(&output, &plan, Existing::Refuse).unwrap();
    let refused = |plan: &Plan| folder.check(plan).unwrap_err().to_string();
    let elsewhere = Plan { machine: "cpu avx2".into(), ..plan.clone() };
    assert!(
        refused(&elsewhere).contains("is a study on test, but this is cpu avx2: a study has one "),
        "{elsewhere:?}"
    );
    let grey = gs_core::Image::filled(48, 40, [0.5; 3]).unwrap();
    gs_io::write_png(place.path().join("stripes.png"), &grey).unwrap();
    let line = refused(&laid_out(study(), place.path()));
    assert!(
        line.contains("image stripes.png (") && line.contains(") is not the one that the study began with"),
        "{line}"
    );
    let file = output.join("machine.json");
    let text = fs::read_to_string(&file).unwrap();
    fs::write(&file, text.replace(VERSION, "0.0.9")).unwrap();
    let line = refused(&plan);
    assert!(
        line.contains("is a study by version 0.0.9 of gs, but this is 0.") && line.contains("use that version"),
        "{line}"
    );
    fs::write(&file, &text[..20]).unwrap();
    assert!(refused(&plan).contains("machine.json is missing or damaged"));
}

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
    assert_eq!(folder.remove_damaged(&results).unwrap(), [2, 5, 6]);
    let counter = Counter::default();
    conduct(&plan, &[&cpu(1)], &folder, &counter).unwrap();
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
        let conducted = conduct(&plan, &[&cpu(1)], &folder, &Meddler { folder: folder.path(), plan: &plan, changed });
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
fn a_result_that_cannot_be_stored_ends_the_work_and_leaves_the_run_to_others() {
    let place = place();
    let plan = laid_out(study(), place.path());
    let folder = StudyFolder::prepare(&place.path().join("out"), &plan, Existing::Refuse).unwrap();
    // Pictures of the first seed cannot be stored.
    fs::remove_dir(folder.file("pictures")).unwrap();
    let line = conduct(&plan, &[&cpu(1)], &folder, &()).unwrap_err().to_string();
    assert!(line.contains("cannot be written: there is no folder "), "{line}");
    assert_eq!(folder.running(&plan).unwrap(), [], "given back");
    fs::create_dir(folder.file("pictures")).unwrap();
    assert_eq!(conduct(&plan, &[&cpu(1)], &folder, &()).unwrap(), Conducted::Whole);
    let names: Vec<_> = fs::read_dir(folder.file("runs")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names.len(), plan.runs.len(), "{names:?}");
}

#[test]
fn a_study_replaces_no_file_that_is_not_a_studys() {
    let place = place();
    let output = place.path().join("out");
    let plan = laid_out(study(), place.path());
    fs::create_dir(&output).unwrap();
    fs::write(output.join("report.html"), "mine").unwrap();
    let prepare = |existing, overwrite| {
        let safety = Safety { overwrite, ..Safety::default() };
        StudyFolder::prepare_with(&output, &plan, existing, &safety, None)
    };
    let refused = prepare(Existing::Refuse, false).unwrap_err().to_string();
    assert!(refused.contains("report.html: is in the way"), "{refused}");
    assert_eq!(fs::read_dir(&output).unwrap().count(), 1, "nothing is begun");
    drop(prepare(Existing::Refuse, true).unwrap());
    // The refused run did not write the report, so it is still the user's. In a folder of a version
    // without an index, all files count as a study's.
    prepare(Existing::Resume, false).unwrap_err();
    fs::write(output.join("runs.csv"), "of an older version").unwrap();
    fs::remove_file(output.join(".gs-files.json")).unwrap();
    drop(prepare(Existing::Resume, false).unwrap());

    // A study that is resumed from the file in its own folder does not change that file.
    let own = output.join("study.toml");
    let text = format!("# mine\n{}", fs::read_to_string(&own).unwrap());
    fs::write(&own, &text).unwrap();
    let safety = Safety { inputs: vec![own.clone()], overwrite: false };
    StudyFolder::prepare_with(&output, &plan, Existing::Resume, &safety, None).unwrap();
    assert_eq!(fs::read_to_string(&own).unwrap(), text);
}

/// Fails at small budgets by an error, at others by a panic.
struct Moody;

impl DensityPolicy for Moody {
    fn plan(&self, seen: &Observation<'_>, _: &mut Rng) -> Result<EditPlan<Gaussian2d>, CoreError> {
        match seen.budget {
            30 => Err(CoreError::State("not today".to_owned())),
            _ => panic!("not at all"),
        }
    }

    fn statistics(&self) -> Statistics {
        Statistics::None
    }

    fn needs_residual(&self) -> bool {
        false
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
    conduct(&plan, &[&cpu(1), &cpu(1)], &folder, &counter).unwrap();
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
        headlines.iter().all(|line| line.contains("; no verdict on moody: no pair of finished runs on ")),
        "{headlines:?}"
    );
    // The other arms are compared as if it did not exist.
    let difference = results.difference(Matching::Iterations, Metric::Psnr, 60, 2, 0);
    assert_eq!((difference.pairs, results.difference(Matching::Count, Metric::Psnr, 60, 1, 0).pairs), (2, 0));
    // Failed runs are tried again when the study is resumed, and not before.
    let begun = |folder: &StudyFolder| {
        let again = Counter::default();
        conduct(&plan, &[&cpu(1)], folder, &again).unwrap();
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
    // The foreign policy has the results of the arm `none`, to the bit.
    let scenes = |arm: usize| results.finished(arm, 60).map(|(_, end)| end.scene.clone()).collect::<Vec<_>>();
    assert_eq!(scenes(2), scenes(0));
    assert_ne!(scenes(1), scenes(0));
    replay(&plan, 3, &cpu(1), &folder).unwrap();
}

#[test]
fn equal_arms_show_no_difference_and_different_counts_are_not_compared() {
    let place = place();
    // Six images are the fewest for an interval.
    for i in 0..6 {
        let waves =
            |x: u32, y: u32| [0.0, 1.0, 2.0].map(|c| 0.5 + 0.4 * ((x + 2 * y) as f32 / (3 + i) as f32 + c).sin());
        let name = format!("{i}.png");
        gs_io::write_png(place.path().join(name), &gs_core::Image::from_fn(24, 20, waves).unwrap()).unwrap();
    }
    let mut twins = study().with(|s| s.images = (0..6).map(|i| format!("{i}.png")).collect());
    twins.arms.push(twins.arms[0].clone().with(|arm| arm.name = "none-again".to_owned()));
    let plan = laid_out(twins, place.path());
    let folder = conducted(&plan, &place.path().join("out"), 1, 1);
    let results = Results::read(&plan, &folder).unwrap();
    let twins = results.difference(Matching::Count, Metric::Psnr, 60, 2, 0);
    assert_eq!((twins.mean, twins.verdict), (Some(0.0), Verdict::CannotTell));
    assert_eq!(twins.remarks, [ResultRemark::FewSeeds { seeds: 2 }]);
    let grown = results.difference(Matching::Count, Metric::Psnr, 60, 1, 0);
    assert_eq!(grown.verdict, Verdict::CannotTell);
    assert!(grown.remarks.iter().any(|remark| remark.to_string().starts_with("counts differ: ")), "{grown:?}");
    let after_steps = results.difference(Matching::Iterations, Metric::Psnr, 60, 1, 0);
    assert_eq!((after_steps.pairs, after_steps.verdict), (6, Verdict::Better), "{after_steps:?}");
    let differences = fs::read_to_string(folder.file("differences.csv")).unwrap();
    assert_eq!(
        differences.lines().count(),
        1 + 2 * 3 * (2 + 1),
        "2 budgets, 3 pairs; PSNR and SSIM at equal count, PSNR"
    );
}

#[test]
fn the_report_is_one_page_with_all_its_pictures() {
    let place = place();
    let plan = laid_out(study(), place.path());
    let folder = conducted(&plan, &place.path().join("out"), 1, 2);
    let page = fs::read_to_string(folder.file("report.html")).unwrap();
    for expected in [
        VERSION,
        "Few seeds: 2, 5 would do.",
        "2 images are too few: 6 at least",
        "tr class=\"remark\"",
        "Which arm wins",
        "Does growth help?",
        "gs study small.toml",
        "percentile",
        "<svg",
        "data:image/jpeg;base64,",
    ] {
        assert!(page.contains(expected), "{expected}");
    }
    let linked = page.matches("src=\"").count();
    assert_eq!(linked, 2 * (1 + 2 * 2), "two images, each with two arms and their errors");
    assert_eq!(page.matches("src=\"data:").count(), linked, "nothing from elsewhere");
    assert!(!page.contains("href=") && !page.contains("<script"));
    for plot in ["quality-over-count", "quality-over-time-60", "growth-30", "differences-at-equal-time"] {
        assert!(folder.file("plots").join(format!("{plot}.svg")).is_file(), "{plot}");
        gs_io::read_image(folder.file("plots").join(format!("{plot}.png"))).unwrap();
    }
}
