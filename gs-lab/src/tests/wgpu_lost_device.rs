//! A GPU that is lost during a study stops the study: nothing is recorded of pending runs, and the
//! study can be resumed on another device.

use pollster::FutureExt as _;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::{
    Error, Existing, Places, Plan, Results, Study, StudyFolder, conduct,
    run::{RunOutcome, Watcher},
    study::Run,
};
use gs_jobs::WorkSettings;
use gs_wgpu::{WgpuRasterizer, WgpuSettings};

const STUDY: &str = "name = 'lost'\nimages = ['paper']\nbudgets = [20]\nseeds = [0, 1, 2, 3]\npreset = 'paper'\niterations = 3\n\
    [[arm]]\nname = 'none'\nsettings.policy.kind = 'none'\n";

fn wgpu() -> WgpuRasterizer {
    WgpuRasterizer::new(WgpuSettings::default()).block_on().expect("`cargo xtask test` installs a driver")
}

fn plan(study: &str) -> Plan {
    Plan::new(Study::from_toml(study, "lost.toml").unwrap(), &Places::default(), "test").unwrap()
}

/// Loses the device when the given row begins.
struct LoseAt<'a> {
    rasterizer: &'a WgpuRasterizer,
    row: usize,
    begun: AtomicUsize,
}

impl Watcher for LoseAt<'_> {
    fn begun(&self, run: &Run) {
        self.begun.fetch_add(1, Ordering::Relaxed);
        if run.row == self.row {
            self.rasterizer.lose_device();
        }
    }
}

#[test]
fn a_lost_device_stops_the_study_and_records_nothing() {
    let plan = plan(STUDY);
    let place = tempfile::tempdir().unwrap();
    let folder = StudyFolder::prepare(place.path(), &plan, Existing::Refuse).unwrap();
    let lost = wgpu();
    let watcher = LoseAt { rasterizer: &lost, row: 3, begun: AtomicUsize::new(0) };
    let error = conduct(&plan, &[&lost], &folder, &WorkSettings::default(), &watcher).unwrap_err();
    assert!(matches!(error, Error::Backend { row: 3, .. }), "{error:?}");
    let words = error.to_string();
    assert!(words.contains("row 3 (none, paper, 20 Gaussians, seed 2)") && words.contains("lost"), "{words}");
    assert!(words.ends_with("start gs study again with --resume"), "{words}");
    assert_eq!(watcher.begun.into_inner(), 3, "nothing is begun after it");
    let ended: Vec<bool> = Results::read(&plan, &folder).unwrap().records.iter().map(Option::is_some).collect();
    assert_eq!(ended, [true, true, false, false]);

    conduct(&plan, &[&wgpu()], &folder, &WorkSettings::default(), &()).unwrap();
    let results = Results::read(&plan, &folder).unwrap();
    assert!(results.records.iter().flatten().all(|record| matches!(record.outcome, RunOutcome::Finished(_))));
    assert_eq!(results.missing().count(), 0);
}

#[test]
fn unsupported_settings_are_refused_before_any_run() {
    let arm = "[[arm]]\nname = 'smooth'\nsettings.policy.kind = 'none'\nsettings.render.accuracy.cut = 'smooth'\n";
    let plan = plan(&format!("{STUDY}{arm}"));
    let place = tempfile::tempdir().unwrap();
    let folder = StudyFolder::prepare(place.path(), &plan, Existing::Refuse).unwrap();
    let refused = conduct(&plan, &[&wgpu()], &folder, &WorkSettings::default(), &()).unwrap_err().to_string();
    assert!(refused.starts_with("study `lost`: arm `smooth`: backend wgpu does not offer"), "{refused}");
    assert!(Results::read(&plan, &folder).unwrap().records.iter().all(Option::is_none));
}
