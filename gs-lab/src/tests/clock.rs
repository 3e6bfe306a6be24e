//! Studies whose times are CPU time.

use std::{sync::Arc, thread, time::Duration};

use crate::{
    Error, Existing, Places, Plan, Study, StudyFolder, conduct,
    run::RunOutcome,
    study::{Arm, Clock},
};
use cpu_time::ProcessTime;
use gs_core::{EditPlan, Error as CoreError, Gaussian2d};
use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_density::{DensityPolicy, Observation, Rng};
use gs_jobs::WorkSettings;

const STUDY: &str = "name = 'clocks'\nimages = ['paper-64px']\nbudgets = [30]\nseeds = [0]\npreset = 'paper'\n\
    iterations = 20\nclock = 'cpu'\nsettings.rounds = { every = 1, from = 1, until = 11 }\n\
    [[arm]]\nname = 'none'\npolicy = 'none'\n";

fn plan(text: &str) -> Plan {
    plan_of(Study::from_toml(text, "clocks.toml").unwrap())
}

fn plan_of(study: Study) -> Plan {
    Plan::new(study, &Places::default(), "test").unwrap()
}

fn one_thread() -> CpuRasterizer {
    CpuRasterizer::new(CpuSettings::default().with(|s| s.threads = Some(1))).unwrap()
}

#[test]
fn a_study_names_its_clock_and_runs_by_another_clock_are_others() {
    let cpu = plan(STUDY);
    assert_eq!(cpu.study.clock, Clock::Cpu);
    assert!(cpu.study.to_toml().unwrap().contains("clock = \"cpu\""));
    let wall = plan(&STUDY.replace("clock = 'cpu'\n", ""));
    assert_eq!(wall.study.clock, Clock::Wall);
    assert!(!wall.study.to_toml().unwrap().contains("clock ="));
    assert_eq!(plan(&STUDY.replace("'cpu'", "'wall'")).runs[0].address, wall.runs[0].address);
    assert_ne!(cpu.runs[0].address, wall.runs[0].address);
    let wrong = Study::from_toml(&STUDY.replace("'cpu'", "'sun'"), "clocks.toml").unwrap_err().to_string();
    assert!(wrong.starts_with("clocks.toml: line 7: unknown name `sun`"), "{wrong}");
}

/// Does nothing, for a long time.
struct Sleeper;

const SLEEP: Duration = Duration::from_millis(100);

impl DensityPolicy for Sleeper {
    fn plan(&self, _: &Observation<'_>, _: &mut Rng) -> Result<EditPlan<Gaussian2d>, CoreError> {
        thread::sleep(SLEEP);
        Ok(EditPlan::default())
    }
}

/// The time of a run with ten naps, and that of its last row, s.
fn seconds(clock: Clock) -> [f64; 2] {
    let mut study = Study::from_toml(STUDY, "clocks.toml").unwrap();
    study.clock = clock;
    study.arms = vec![Arm::with_policy("sleeper", "sleeps", Arc::new(Sleeper))];
    let plan = plan_of(study);
    let place = tempfile::tempdir().unwrap();
    let folder = StudyFolder::prepare(place.path(), &plan, Existing::Refuse).unwrap();
    conduct(&plan, &[&one_thread()], &folder, &WorkSettings::default(), &()).unwrap();
    match folder.record(&plan.runs[0]).unwrap().unwrap().outcome {
        RunOutcome::Finished(finished) => [finished.seconds, finished.trajectory.last().unwrap().seconds],
        RunOutcome::Failed { error } => panic!("{error}"),
    }
}

/// The time is compared with the CPU time that the process took meanwhile, to which other tests may
/// add. `cargo nextest` has a process for each test, so there it is much less than the naps.
#[test]
fn cpu_time_leaves_out_the_time_in_which_a_run_waits() {
    let naps = 10.0 * SLEEP.as_secs_f64();
    let [wall, wall_row] = seconds(Clock::Wall);
    assert!(wall >= naps && wall_row >= naps, "{wall} {wall_row}");
    let started = ProcessTime::now();
    let [cpu, cpu_row] = seconds(Clock::Cpu);
    let all = started.elapsed().as_secs_f64();
    assert!(cpu_row > 0.0 && cpu_row <= cpu && cpu <= all, "{cpu_row} {cpu} {all}");
}

#[test]
fn runs_that_would_share_a_clock_are_refused_before_any_begins() {
    let plan = plan(STUDY);
    let place = tempfile::tempdir().unwrap();
    let folder = StudyFolder::prepare(place.path(), &plan, Existing::Refuse).unwrap();
    let error = conduct(&plan, &[&one_thread(), &one_thread()], &folder, &WorkSettings::default(), &()).unwrap_err();
    assert!(matches!(error, Error::Work { .. }), "{error:?}");
    let words = error.to_string();
    assert!(words.contains("2 runs side by side in one process share its CPU time"), "{words}");
    assert!(folder.ended().unwrap().is_empty());
}

mod wgpu {
    use crate::run::refuse_unsupported;
    use gs_wgpu::{WgpuRasterizer, WgpuSettings};
    use pollster::FutureExt as _;

    use super::*;

    #[test]
    fn cpu_time_of_a_gpu_is_refused() {
        let opened = WgpuRasterizer::new(WgpuSettings::default()).block_on();
        let gpu = opened.expect("`cargo xtask test` installs a driver");
        let error = refuse_unsupported(&plan(STUDY), &gpu).unwrap_err().to_string();
        assert!(error.starts_with("study `clocks`: clock: CPU time says nothing about wgpu"), "{error}");
        assert!(refuse_unsupported(&plan(&STUDY.replace("'cpu'", "'wall'")), &gpu).is_ok());
    }
}
