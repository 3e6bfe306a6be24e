//! `Study`: studies with arms whose policies are written in Python.

use std::{
    path::PathBuf,
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed},
    },
    thread,
    time::Duration,
};

use gs_backend::{AnyRasterizer, Chosen, Request, Wanted, block_on, host_threads};
use gs_core::{Scene2d, Scene3d};
use gs_lab::{
    Existing, Places, Plan, Results, StudyFolder, conduct_with, report,
    study::{AnyPolicy, Arm, AtEnd, Conducted, OwnPolicy, Run, RunOutcome, Shard, Watcher, WorkSettings, write_tables},
};
use gs_train::ForeignPolicy;
use pyo3::{exceptions::PyRuntimeError, prelude::*, types::PyAny};

use crate::{
    errors::{self, IntoPython},
    policy::{PolicyArgument, PythonPolicy, Raised},
};

/// A study: arms x images or scenes x budgets x seeds.
#[pyclass(frozen, module = "gaussian_splats")]
#[derive(Debug)]
pub(crate) struct Study {
    study: gs_lab::Study,
    places: Places,
    raised: Raised,
}

#[pymethods]
impl Study {
    /// `definition` is the text of a study's file, or the name of a built-in study; each of `arms`
    /// is (name, fingerprint, policy, about).
    #[new]
    #[pyo3(signature = (definition, arms, data = None, beside = None))]
    fn new(
        definition: &str,
        arms: Vec<(String, String, Bound<'_, PyAny>, String)>,
        data: Option<PathBuf>,
        beside: Option<PathBuf>,
    ) -> PyResult<Self> {
        let study = match definition.contains('=') {
            true => gs_lab::Study::from_toml(definition, "definition"),
            false => gs_lab::built_in(definition),
        };
        let mut study = study.map_err(IntoPython::into_python)?;
        let raised = Raised::default();
        for (name, fingerprint, policy, about) in arms {
            let mut arm = match PolicyArgument::of(&policy)? {
                PolicyArgument::Named(_) => {
                    let name_of_policy: String = policy.extract()?;
                    Arm::named(name).with(|arm| arm.policy = Some(name_of_policy))
                }
                PolicyArgument::InPython(object) => {
                    let usual = gs_density::Policy::from_name("absolute").map_err(IntoPython::into_python)?;
                    let usual = if study.is_of_scenes() { usual.for_3d() } else { usual };
                    let actions = usual.actions().copied().unwrap_or_default();
                    let own = Arc::new(PythonPolicy::new(&object, actions, raised.clone())?);
                    let policy = match study.is_of_scenes() {
                        true => AnyPolicy::In3d(own as ForeignPolicy<Scene3d>),
                        false => AnyPolicy::In2d(own as ForeignPolicy<Scene2d>),
                    };
                    Arm::named(name).with(|arm| {
                        arm.policy = Some("absolute".to_owned());
                        arm.own_policy = Some(OwnPolicy { fingerprint, policy });
                    })
                }
            };
            arm.about = about;
            study.arms.push(arm);
        }
        study.validate().map_err(IntoPython::into_python)?;
        let places = Places { data, beside, ..Places::default() };
        Ok(Self { study, places, raised })
    }

    /// Number of runs.
    #[getter]
    fn runs(&self) -> usize {
        self.study.runs()
    }

    /// Does the runs and writes tables and report. Returns the headlines.
    #[pyo3(signature = (output, *, jobs = 1, resume = false, progress = None))]
    fn run(
        &self,
        py: Python<'_>,
        output: PathBuf,
        jobs: usize,
        resume: bool,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Vec<String>> {
        let existing = if resume { Existing::Resume } else { Existing::Refuse };
        let work = WorkSettings::default();
        let study = self.prepared(py, output, jobs, existing)?;
        self.conducted(py, &study, &work, progress)?;
        self.reported(py, &study)
    }

    /// Claims runs of a folder that several processes share, and does them until none is left.
    #[pyo3(signature = (output, *, jobs = 1, shard = None, progress = None))]
    fn work(
        &self,
        py: Python<'_>,
        output: PathBuf,
        jobs: usize,
        shard: Option<(u32, u32)>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<()> {
        let work = WorkSettings::default().with(|work| {
            work.shard = shard.map(|(index, count)| Shard { index, count });
            work.at_end = AtEnd::Leave;
        });
        work.validate().map_err(IntoPython::into_python)?;
        let study = self.prepared(py, output, jobs, Existing::Resume)?;
        self.conducted(py, &study, &work, progress)
    }

    /// Writes tables and report of the runs that have ended so far. Returns the headlines.
    fn report(&self, py: Python<'_>, output: PathBuf) -> PyResult<Vec<String>> {
        let study = self.prepared(py, output, 1, Existing::Resume)?;
        self.reported(py, &study)
    }

    fn __repr__(&self) -> String {
        format!("<Study {}: {} runs>", self.study.name, self.study.runs())
    }
}

/// A study with its folder and backends.
struct Prepared {
    plan: Plan,
    folder: StudyFolder,
    backends: Vec<Chosen>,
}

impl Study {
    fn prepared(&self, py: Python<'_>, output: PathBuf, jobs: usize, existing: Existing) -> PyResult<Prepared> {
        if jobs == 0 {
            return Err(errors::value("jobs", "must be at least 1"));
        }
        py.detach(|| {
            let threads = (host_threads(None).map_err(IntoPython::into_python)? / jobs).max(1);
            let request = Request::default().with(|request| {
                request.wanted = Wanted::Cpu;
                request.threads = Some(threads);
            });
            let open = |_| block_on(gs_backend::open(&request)).map_err(IntoPython::into_python);
            let backends: Vec<Chosen> = (0..jobs).map(open).collect::<PyResult<_>>()?;
            let level = backends[0].rasterizer.simd_level().unwrap_or_default();
            let machine = format!("cpu {level}");
            let plan = Plan::new(self.study.clone(), &self.places, machine).map_err(IntoPython::into_python)?;
            gs_lab::study::refuse_unsupported(&plan, &backends[0].rasterizer).map_err(IntoPython::into_python)?;
            let folder = StudyFolder::prepare(&output, &plan, existing).map_err(IntoPython::into_python)?;
            Ok(Prepared { plan, folder, backends })
        })
    }

    /// Does runs in a thread, so that this one can look for Ctrl-C.
    fn conducted(
        &self,
        py: Python<'_>,
        study: &Prepared,
        work: &WorkSettings,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<()> {
        let Prepared { plan, folder, backends } = study;
        let team: Vec<&AnyRasterizer> = backends.iter().map(|chosen| &chosen.rasterizer).collect();
        let watch = Watch::default();
        let mut interrupted: PyResult<()> = Ok(());
        let mut told = 0;
        let conducted = py.detach(|| {
            thread::scope(|scope| {
                let conducting = scope.spawn(|| conduct_with(plan, &team, folder, work, &watch));
                while !conducting.is_finished() {
                    thread::sleep(Duration::from_millis(50));
                    let ended = watch.ended.load(Relaxed);
                    if interrupted.is_ok() {
                        interrupted = Python::attach(|py| {
                            py.check_signals()?;
                            if let Some(progress) = progress.as_ref().filter(|_| ended != told) {
                                progress.call1(py, (ended, plan.runs.len()))?;
                            }
                            Ok(())
                        });
                        told = ended;
                        watch.stops.store(interrupted.is_err(), Relaxed);
                    }
                }
                conducting.join()
            })
        });
        interrupted?;
        let conducted = conducted.map_err(|panic| errors::of_panic(&*panic))?.map_err(IntoPython::into_python)?;
        match conducted {
            Conducted::Stopped => Err(PyRuntimeError::new_err("the study was stopped")),
            _ => Ok(()),
        }
    }

    fn reported(&self, py: Python<'_>, study: &Prepared) -> PyResult<Vec<String>> {
        let Prepared { plan, folder, .. } = study;
        let headlines = py.detach(|| {
            let results = Results::read(plan, folder).map_err(Ok)?;
            let failed = results.records.iter().flatten().filter_map(|record| match &record.outcome {
                RunOutcome::Failed { error } => Some(error.clone()),
                RunOutcome::Finished(_) => None,
            });
            let failed: Vec<String> = failed.collect();
            if failed.len() == plan.runs.len() {
                return Err(Err(failed.into_iter().next().unwrap_or_default()));
            }
            let write = || {
                write_tables(&results, folder)?;
                report::write(&results, folder, "gaussian_splats.Study.run")
            };
            write().map_err(Ok)?;
            Ok(report::headlines(&results))
        });
        headlines.map_err(|error: Result<gs_lab::Error, String>| match error {
            Ok(error) => error.into_python(),
            Err(first) => {
                let raised = self.raised.lock().ok().and_then(|mut raised| raised.take());
                raised.unwrap_or_else(|| PyRuntimeError::new_err(format!("all runs failed, the first since {first}")))
            }
        })
    }
}

/// Counts runs, and stops them.
#[derive(Debug, Default)]
struct Watch {
    ended: AtomicUsize,
    stops: AtomicBool,
}

impl Watcher for Watch {
    fn ended(&self, _: &Run, _: &RunOutcome) {
        self.ended.fetch_add(1, Relaxed);
    }

    fn wants_stop(&self) -> bool {
        self.stops.load(Relaxed)
    }
}
