//! `TrainRun` and `Training`: a training of a 3D scene, and its result.

use std::{path::PathBuf, sync::Arc};

use gs_backend::block_on;
use gs_core::Scene3d as CoreScene3d;
use gs_io::dataset::{Dataset, Split};
use gs_train::{
    CustomPolicy, SettingsFile as _, TrainPreset, TrainSettings, Trainer3d,
    train::{Start as Initial, StartName, TrainSummary, Views},
};
use pyo3::{
    prelude::*,
    types::{PyAny, PyBytes, PyDict},
};

use super::{
    Progress, Start, check_settings, conduct, own_policy,
    worker::{Shared, Worker},
};
use crate::{
    backend,
    convert::{
        dataset::read_dataset,
        errors::{self, IntoPython},
        settings::{self, Given},
    },
    density::policy::PolicyArgument,
    scene::scene3d::Scene3d,
};

/// What a training ends with.
struct TrainDone {
    scene: CoreScene3d,
    render: gs_core::RenderSettings,
    summary: TrainSummary,
}

#[doc = doc!("TrainRun")]
#[pyclass(frozen, module = "gaussian_splats")]
pub(crate) struct TrainRun {
    worker: Worker<TrainDone>,
    steps: u32,
}

#[pymethods]
impl TrainRun {
    #[new]
    #[pyo3(signature = (dataset, gaussians = None, *, preset = None, iterations = None, start = None, reading = None, policy = None, settings = None, backend = None, checkpoint = None))]
    #[allow(clippy::too_many_arguments, reason = "keyword arguments")]
    fn new(
        py: Python<'_>,
        dataset: PathBuf,
        gaussians: Option<u32>,
        preset: Option<&str>,
        iterations: Option<u32>,
        start: Option<&Bound<'_, PyAny>>,
        reading: Option<&Bound<'_, PyAny>>,
        policy: Option<&Bound<'_, PyAny>>,
        settings: Option<&Bound<'_, PyAny>>,
        backend: Option<&Bound<'_, PyAny>>,
        checkpoint: Option<PathBuf>,
    ) -> PyResult<Self> {
        let dataset = read_dataset(py, &dataset, reading, None)?;
        let chosen = backend::chosen(py, backend)?;
        let policy = policy.map(PolicyArgument::of).transpose()?;
        let given = Given::of("settings", preset, settings)?;
        let scene = start.and_then(|start| start.cast::<Scene3d>().ok()).map(Bound::get);
        let train = wanted(&dataset, scene, (gaussians, iterations), policy.as_ref(), given)?;
        let initial = first(&dataset, start, &train)?;
        let start = Start::read(py, checkpoint)?;
        let steps = train.iterations.saturating_sub(start.step());
        let shared = Arc::new(Shared::default());
        let own = own_policy(policy, train.policy.actions(), &shared)?.map(|own| own as CustomPolicy<CoreScene3d>);
        let worker = Worker::spawn(shared, move |reporter| {
            chosen.within(|rasterizer| {
                let views = Views::of_dataset(&dataset);
                let mut trainer = match start.checkpoint {
                    Some(checkpoint) => {
                        let trainer = Trainer3d::resume_views(rasterizer, views, checkpoint)?;
                        let held = trainer.settings_to_repeat();
                        check_settings(held, &train.begun_as(held, &initial))?;
                        trainer
                    }
                    None => block_on(Trainer3d::from_views(rasterizer, views, initial, train))?,
                };
                if let Some(own) = own {
                    trainer = trainer.controlled_by(own);
                }
                conduct(&mut trainer, reporter, start.file.as_deref())?;
                let evaluation = block_on(trainer.evaluate(&|_, _, _| Ok(())))?;
                let summary = block_on(TrainSummary::new(&trainer, evaluation))?;
                Ok(TrainDone { scene: block_on(trainer.scene())?, render: trainer.shown(), summary })
            })
        })?;
        Ok(Self { worker, steps })
    }

    fn __iter__(this: Py<Self>) -> Py<Self> {
        this
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Progress>> {
        self.worker.next(py)
    }

    fn __len__(&self) -> usize {
        self.steps as usize
    }

    #[doc = doc!("TrainRun.stop")]
    fn stop(&self) {
        self.worker.stop();
    }

    #[doc = doc!("TrainRun.result")]
    fn result(&self, py: Python<'_>) -> PyResult<Training> {
        let (done, history) = &*self.worker.result(py)?;
        let scene = Scene3d::of(done.scene.clone(), Some(done.render), done.summary.frame);
        let summary = settings::to_python(py, &done.summary)?;
        let psnr = done.summary.evaluation.psnr;
        let history = history.to_python(py)?.unbind();
        Ok(Training { scene: Py::new(py, scene)?, summary: summary.unbind(), history, psnr })
    }

    fn __repr__(&self) -> String {
        format!("<TrainRun of {} steps>", self.steps)
    }
}

/// What a training starts from: a scene, or what a name says.
fn first(dataset: &Dataset, start: Option<&Bound<'_, PyAny>>, settings: &TrainSettings) -> PyResult<Initial> {
    let name = match start {
        None => StartName::usual_for(dataset, settings),
        Some(start) => {
            if let Ok(scene) = start.cast::<Scene3d>() {
                return Ok(Initial::Scene(scene.get().in_frame(dataset.frame)));
            }
            let name = start.extract::<String>();
            settings::named("start", &name.map_err(|_| errors::wrong_type("start", "a name or a Scene3d", start))?)?
        }
    };
    name.of(dataset).map_err(|problem| errors::value("start", problem))
}

/// The settings that the arguments ask for, for this data set. A preset keeps the antialiasing of the
/// scene that the training starts from.
fn wanted(
    dataset: &Dataset,
    scene: Option<&Scene3d>,
    (gaussians, iterations): (Option<u32>, Option<u32>),
    policy: Option<&PolicyArgument<'_>>,
    given: Given<'_>,
) -> PyResult<TrainSettings> {
    let mut train = match &given {
        Given::File(_) if iterations.is_some() => {
            return Err(errors::value("iterations", "the settings file has them, and schedules that follow them"));
        }
        Given::File(file) => {
            TrainSettings::from_toml(&settings::text_of(file)?, file).map_err(IntoPython::into_python)?
        }
        Given::Preset { name, changes } => {
            let preset: TrainPreset = settings::named("preset", name)?;
            let cameras = dataset.views_of(Split::Train).map(|view| &view.camera);
            let mut train = preset.settings_for(iterations, dataset.kind, cameras);
            if let Some(scene) = scene {
                train.render.effects.antialias = scene.render([0.0; 3]).effects.antialias;
            }
            settings::with_rounds("settings", train, changes.as_ref())?
        }
    };
    if let Some(gaussians) = gaussians {
        train = train.with_gaussians(gaussians);
    }
    if let Some(policy) = policy {
        train = train.with_policy(policy.named()?);
    }
    if let Given::Preset { changes, .. } = &given {
        train = settings::with("settings", train, changes.as_ref())?;
        let has = |key: &str| changes.as_ref().map_or(Ok(false), |changes| changes.contains(key));
        // Points do not raise a number of the caller's own.
        if has("gaussians")? && !has("gaussians-per-point")? {
            let gaussians = train.gaussians;
            train = train.with_gaussians(gaussians);
        }
        // Nor does a trial lengthen such a run.
        if has("iterations")? && !has("lengthen-to")? {
            train.lengthen_to = 0;
        }
    }
    train.validate().map_err(IntoPython::into_python)?;
    Ok(train)
}

#[doc = doc!("Training")]
#[pyclass(frozen, module = "gaussian_splats", get_all)]
#[derive(Debug)]
pub(crate) struct Training {
    #[doc = doc!("Training.scene")]
    scene: Py<Scene3d>,
    #[doc = doc!("Training.summary")]
    summary: Py<PyAny>,
    #[doc = doc!("Training.history")]
    history: Py<PyDict>,
    #[doc = doc!("Training.psnr")]
    psnr: f64,
}

#[pymethods]
impl Training {
    fn __repr__(&self) -> String {
        format!("<Training: {:.2} dB with {} Gaussians>", self.psnr, self.scene.get().scene.means.len())
    }

    #[doc = doc!("Training._repr_png_")]
    fn _repr_png_<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyBytes>>> {
        self.scene.get().png(py)
    }
}
