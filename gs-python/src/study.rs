//! `Study`: studies with arms whose policies are written in Python.

use std::{
    path::PathBuf,
    process,
    sync::{
        Arc, OnceLock,
        atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed},
    },
    thread,
    time::Duration,
};

use gs_backend::{AnyRasterizer, host_threads};
use gs_core::{Scene2d, Scene3d};
use gs_jobs::{AtEnd, Shard, WorkSettings, slurm};
use gs_lab::{
    Existing, Places, Plan, Results, StudyFolder, conduct, report,
    run::{Conducted, RunOutcome, Watcher},
    study::{Arm, Machine, Run},
};
use gs_train::CustomPolicy;
use pyo3::{exceptions::PyRuntimeError, prelude::*, types::PyAny};
use toml::Table;

use crate::{
    backend::Opened,
    convert::errors::{self, IntoPython, Raised},
    density::policy::{PolicyArgument, PythonPolicy},
};

#[doc = doc!("Study")]
#[pyclass(frozen, module = "gaussian_splats")]
#[derive(Debug)]
pub(crate) struct Study {
    study: gs_lab::Study,
    places: Places,
    backend: String,
    raised: Raised,
}

#[pymethods]
impl Study {
    /// `definition` is the text of a study's file, or the name of a built-in study; each of `arms`
    /// is (name, fingerprint, policy, about).
    #[new]
    #[pyo3(signature = (definition, arms, data, beside, backend))]
    fn new(
        definition: &str,
        arms: Vec<(String, String, Bound<'_, PyAny>, String)>,
        data: Option<PathBuf>,
        beside: Option<PathBuf>,
        backend: String,
    ) -> PyResult<Self> {
        let raised = Raised::default();
        let own = |is_of_scenes: bool| -> PyResult<Vec<Arm>> {
            arms.iter()
                .map(|(name, fingerprint, policy, about)| {
                    let arm = arm_of(name, fingerprint, policy, is_of_scenes, &raised)?;
                    Ok(arm.with(|arm| arm.about.clone_from(about)))
                })
                .collect()
        };
        let study = match definition.contains('=') {
            true => gs_lab::Study::from_toml_and(definition, "definition", own(names_scenes(definition))?),
            false => match gs_lab::built_in(definition) {
                Ok(mut study) => {
                    study.arms.extend(own(study.is_of_scenes())?);
                    study.validate().map(|()| study)
                }
                Err(error) => Err(error),
            },
        };
        let study = study.map_err(IntoPython::into_python)?;
        let places = Places { data, beside, ..Places::default() };
        Ok(Self { study, places, backend, raised })
    }

    #[doc = doc!("Study.runs")]
    #[getter]
    fn runs(&self) -> usize {
        self.study.runs()
    }

    #[doc = doc!("Study.run")]
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
        let study = self.prepared(py, output, jobs, Some(existing))?;
        self.conducted(py, &study, &work, progress)?;
        self.reported(py, &study)
    }

    #[doc = doc!("Study.work")]
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
            work.shard = shard.map(|(index, count)| Shard { index, count }).or_else(slurm::shard);
            work.worker.extend(slurm::task().map(|task| format!(", job {task}")));
            work.at_end = AtEnd::Leave;
        });
        work.validate().map_err(IntoPython::into_python)?;
        let study = self.prepared(py, output, jobs, Some(Existing::Resume))?;
        self.conducted(py, &study, &work, progress)
    }

    #[doc = doc!("Study.report")]
    fn report(&self, py: Python<'_>, output: PathBuf) -> PyResult<Vec<String>> {
        let study = self.prepared(py, output, 1, None)?;
        self.reported(py, &study)
    }

    fn __repr__(&self) -> String {
        format!("<Study {}: {} runs>", self.study.name, self.study.runs())
    }
}

/// The process whose studies use the threads that all of its code shares.
static USER: OnceLock<u32> = OnceLock::new();

/// Refuses studies in a process that was forked after one: the threads did not come along.
fn check_process() -> PyResult<()> {
    if *USER.get_or_init(process::id) == process::id() {
        return Ok(());
    }
    let message = "this process was forked from one that has used a study; start processes by 'spawn'";
    Err(PyRuntimeError::new_err(message))
}

/// Whether a definition is one of 3D scenes; a definition that is no TOML is refused later.
fn names_scenes(definition: &str) -> bool {
    definition.parse::<Table>().is_ok_and(|table| table.contains_key("scenes"))
}

/// The arm of a policy: the name of one of the engine's, or an object in Python.
fn arm_of(
    name: &str,
    fingerprint: &str,
    policy: &Bound<'_, PyAny>,
    is_of_scenes: bool,
    raised: &Raised,
) -> PyResult<Arm> {
    let object = match PolicyArgument::of(policy)? {
        PolicyArgument::Named(_) => {
            let policy: String = policy.extract()?;
            return Ok(Arm::named(name).with(|arm| arm.policy = Some(policy)));
        }
        PolicyArgument::InPython(object) => object,
    };
    let usual = gs_density::Policy::from_name("absolute").map_err(IntoPython::into_python)?;
    let usual = if is_of_scenes { usual.for_3d() } else { usual };
    let actions = usual.actions().copied().unwrap_or_default();
    let own = Arc::new(PythonPolicy::new(&object, actions, raised.clone())?);
    let arm = match is_of_scenes {
        true => Arm::with_policy_3d(name, fingerprint, own as CustomPolicy<Scene3d>),
        false => Arm::with_policy(name, fingerprint, own as CustomPolicy<Scene2d>),
    };
    Ok(arm.with(|arm| arm.policy = Some("absolute".to_owned())))
}

/// A study with its folder and backends.
struct Prepared {
    plan: Plan,
    folder: StudyFolder,
    backends: Vec<Opened>,
}

impl Study {
    /// Makes the folder, or opens it as it is where `existing` does not say what may be in it.
    fn prepared(&self, py: Python<'_>, output: PathBuf, jobs: usize, existing: Option<Existing>) -> PyResult<Prepared> {
        if jobs == 0 {
            return Err(errors::value("jobs", "must be at least 1"));
        }
        check_process()?;
        py.detach(|| {
            let threads = (host_threads(None).map_err(IntoPython::into_python)? / jobs).max(1);
            let backends: Vec<Opened> =
                (0..jobs).map(|_| Opened::new(&self.backend, Some(threads))).collect::<PyResult<_>>()?;
            let rasterizer = backends[0].rasterizer();
            let plan = Plan::new(self.study.clone(), &self.places, Machine::of(rasterizer));
            let plan = plan.map_err(IntoPython::into_python)?;
            let folder = match existing {
                Some(existing) => {
                    gs_lab::run::refuse_unsupported(&plan, rasterizer).map_err(IntoPython::into_python)?;
                    StudyFolder::prepare(&output, &plan, existing)
                }
                None => StudyFolder::open(&output, false),
            };
            let folder = folder.map_err(IntoPython::into_python)?;
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
        let team: Vec<&AnyRasterizer> = backends.iter().map(Opened::rasterizer).collect();
        let watch = Watch::default();
        let mut interrupted: PyResult<()> = Ok(());
        let mut told = 0;
        let conducted = py.detach(|| {
            thread::scope(|scope| {
                let conducting = scope.spawn(|| conduct(plan, &team, folder, work, &watch));
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

    /// What a policy has raised.
    fn raised(&self) -> Option<PyErr> {
        self.raised.lock().ok().and_then(|mut raised| raised.take())
    }

    fn reported(&self, py: Python<'_>, study: &Prepared) -> PyResult<Vec<String>> {
        let Prepared { plan, folder, .. } = study;
        let headlines = py.detach(|| {
            let results = Results::read(plan, folder).map_err(Ok)?;
            let failed = results.failures();
            if failed.len() == plan.runs.len() {
                return Err(Err(failed.first().map_or_else(String::new, |&first| first.to_owned())));
            }
            report::write(&results, folder, "gaussian_splats.Study.run").map_err(Ok)?;
            Ok(report::headlines(&results))
        });
        headlines.map_err(|error: Result<gs_lab::Error, String>| match error {
            Ok(error) => error.into_python(),
            Err(first) => self
                .raised()
                .unwrap_or_else(|| PyRuntimeError::new_err(format!("all runs failed, the first since {first}"))),
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
