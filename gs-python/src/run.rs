//! `FitRun` and `TrainRun`: runs in a thread of their own, which Python follows as iterators.

use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    path::PathBuf,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering::Relaxed},
        mpsc::{Receiver, RecvTimeoutError, Sender, channel},
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use gs_backend::{AnyRasterizer, Chosen, block_on};
use gs_core::{Image, Scene3d as CoreScene3d};
use gs_io::dataset::Split;
use gs_lab::study::DatasetReading;
use gs_train::{
    Control, FitSettings, FitSummary, ForeignPolicy, Observer, Outcome, Preset, TrainPreset, TrainSettings, Trainable,
    Trainer, Trainer3d,
    train::{StartName, TrainSummary, Views},
};
use numpy::PyArray3;
use pyo3::{
    exceptions::PyRuntimeError,
    prelude::*,
    types::{PyAny, PyDict},
};

use crate::{
    arrays,
    backend::{self, Backend},
    errors::{self, IntoPython},
    policy::{PolicyArgument, PythonPolicy, Raised},
    scene2d::Scene2d,
    scene3d::Scene3d,
    settings,
};

/// Least time between two reports without edits.
const INTERVAL: Duration = Duration::from_millis(20);

/// Time between two looks for Ctrl-C.
const SIGNALS: Duration = Duration::from_millis(50);

/// The state of a run after a step.
#[pyclass(frozen, module = "gaussian_splats", get_all)]
#[derive(Debug)]
pub(crate) struct Progress {
    /// Steps done.
    step: u32,
    /// Steps in all.
    iterations: u32,
    /// Training time, s.
    seconds: f64,
    /// Number of Gaussians.
    count: u32,
    /// The last loss that is known.
    loss: f32,
    /// PSNR estimated from the loss, dB; None where the loss is not L2.
    psnr: Option<f64>,
    /// Gaussians cloned, split, seeded and pruned after the step; None without density control.
    edits: Option<(u32, u32, u32, u32)>,
}

#[pymethods]
impl Progress {
    fn __repr__(&self) -> String {
        let Self { step, iterations, count, loss, .. } = self;
        format!("<Progress: step {step} of {iterations}, {count} Gaussians, loss {loss:.4e}>")
    }
}

/// What the thread of a run and the threads of Python share.
#[derive(Debug, Default)]
struct Shared {
    stops: AtomicBool,
    raised: Raised,
}

/// Why there is no result.
enum Failure {
    Error(PyErr),
    Stopped,
}

impl<E: IntoPython> From<E> for Failure {
    fn from(error: E) -> Self {
        Self::Error(error.into_python())
    }
}

/// A run in a thread of its own.
#[derive(Debug)]
struct Worker<T> {
    shared: Arc<Shared>,
    reports: Mutex<Receiver<Progress>>,
    state: Mutex<State<T>>,
}

#[derive(Debug)]
enum State<T> {
    Running(JoinHandle<Result<T, Failure>>),
    Done(Arc<T>),
    Failed,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl<T: Send + Sync + 'static> Worker<T> {
    fn spawn(
        shared: Arc<Shared>,
        work: impl FnOnce(&mut Reporter) -> Result<T, Failure> + Send + 'static,
    ) -> PyResult<Self> {
        let (sender, receiver) = channel();
        let mut reporter = Reporter { shared: shared.clone(), sender, last: None };
        let body = move || {
            let done = catch_unwind(AssertUnwindSafe(|| work(&mut reporter)));
            done.unwrap_or_else(|panic| Err(Failure::Error(errors::of_panic(&*panic))))
        };
        let thread = thread::Builder::new().name("gs-run".to_owned()).spawn(body);
        let thread = thread.map_err(|error| PyRuntimeError::new_err(format!("cannot start a thread: {error}")))?;
        Ok(Self { shared, reports: Mutex::new(receiver), state: Mutex::new(State::Running(thread)) })
    }

    /// The next report; `None` when the run has ended.
    fn next(&self, py: Python<'_>) -> PyResult<Option<Progress>> {
        loop {
            match py.detach(|| locked(&self.reports).recv_timeout(SIGNALS)) {
                Ok(progress) => return Ok(Some(progress)),
                Err(RecvTimeoutError::Disconnected) => {
                    self.result(py)?;
                    return Ok(None);
                }
                Err(RecvTimeoutError::Timeout) => self.check_signals(py)?,
            }
        }
    }

    /// Stops the run where Python has been interrupted.
    fn check_signals(&self, py: Python<'_>) -> PyResult<()> {
        let interrupted = py.check_signals();
        if interrupted.is_err() {
            self.shared.stops.store(true, Relaxed);
            // The checkpoint is written before Python goes on.
            let _ = self.result(py);
        }
        interrupted
    }

    /// Waits for the end.
    fn result(&self, py: Python<'_>) -> PyResult<Arc<T>> {
        loop {
            // Nobody waits for the lock and for the interpreter at once.
            let is_done = py.detach(|| match &*locked(&self.state) {
                State::Running(thread) => thread.is_finished(),
                State::Done(_) | State::Failed => true,
            });
            if is_done {
                break;
            }
            py.detach(|| thread::sleep(Duration::from_millis(1)));
            if !self.shared.stops.load(Relaxed) {
                self.check_signals(py)?;
            }
        }
        let ended = py.detach(|| {
            let mut state = locked(&self.state);
            match std::mem::replace(&mut *state, State::Failed) {
                State::Done(done) => {
                    *state = State::Done(done.clone());
                    Ok(done)
                }
                State::Running(thread) => match thread.join() {
                    Ok(Ok(done)) => {
                        let done = Arc::new(done);
                        *state = State::Done(done.clone());
                        Ok(done)
                    }
                    Ok(Err(failure)) => Err(Some(failure)),
                    Err(panic) => Err(Some(Failure::Error(errors::of_panic(&*panic)))),
                },
                State::Failed => Err(None),
            }
        });
        ended.map_err(|failure| match failure {
            Some(Failure::Error(error)) => locked(&self.shared.raised).take().unwrap_or(error),
            Some(Failure::Stopped) => PyRuntimeError::new_err("the run was stopped before its end"),
            None => PyRuntimeError::new_err("the run has no result: it failed or was stopped before its end"),
        })
    }
}

impl<T> Drop for Worker<T> {
    fn drop(&mut self) {
        self.shared.stops.store(true, Relaxed);
    }
}

/// Reports to Python, and stops the run where Python wants that.
struct Reporter {
    shared: Arc<Shared>,
    sender: Sender<Progress>,
    last: Option<Instant>,
}

impl Observer for Reporter {
    fn on_step(&mut self, progress: &gs_train::Progress) -> Control {
        let is_due = self.last.is_none_or(|last| last.elapsed() >= INTERVAL);
        if is_due || progress.edits.is_some() || progress.is_last() {
            self.last = Some(Instant::now());
            let report = Progress {
                step: progress.step,
                iterations: progress.iterations,
                seconds: progress.seconds,
                count: progress.count,
                loss: progress.loss,
                psnr: progress.psnr(),
                edits: progress.edits.map(|edits| (edits.cloned, edits.split, edits.seeded, edits.pruned())),
            };
            // Nobody listens after the run has been dropped.
            let _ = self.sender.send(report);
        }
        if self.shared.stops.load(Relaxed) { Control::Stop } else { Control::Continue }
    }
}

/// Runs a trainer to its end. If it is stopped, its checkpoint goes to the file.
fn conducted<S: Trainable>(
    trainer: &mut Trainer<'_, AnyRasterizer, S>,
    reporter: &mut Reporter,
    checkpoint: Option<&PathBuf>,
) -> Result<(), Failure>
where
    AnyRasterizer: gs_core::Optimizer<S>,
{
    if block_on(trainer.run(reporter))? == Outcome::Finished {
        return Ok(());
    }
    if let Some(path) = checkpoint {
        let checkpoint = block_on(trainer.saved())?;
        gs_io::write_checkpoint(path, &checkpoint)?;
    }
    Err(Failure::Stopped)
}

/// What a fit ends with.
struct FitDone {
    scene: gs_core::Scene2d,
    render: gs_core::RenderSettings,
    image: Image,
    summary: FitSummary,
}

/// A fit under way.
#[pyclass(frozen, module = "gaussian_splats")]
pub(crate) struct FitRun {
    worker: Worker<FitDone>,
    backend: Arc<Chosen>,
    iterations: u32,
}

#[pymethods]
impl FitRun {
    #[new]
    #[pyo3(signature = (image, gaussians = None, *, preset = "standard", iterations = None, policy = None, settings = None, backend = None, checkpoint = None))]
    #[allow(clippy::too_many_arguments, reason = "keyword arguments")]
    fn new(
        py: Python<'_>,
        image: &Bound<'_, PyAny>,
        gaussians: Option<u32>,
        preset: &str,
        iterations: Option<u32>,
        policy: Option<&Bound<'_, PyAny>>,
        settings: Option<&Bound<'_, PyDict>>,
        backend: Option<&Bound<'_, Backend>>,
        checkpoint: Option<PathBuf>,
    ) -> PyResult<Self> {
        let target = target(py, image)?;
        let chosen = backend::chosen(py, backend)?;
        let preset: Preset = settings::named("preset", preset)?;
        let policy = policy.map(PolicyArgument::of).transpose()?;
        let mut fit = FitSettings::from_preset(preset, target.size(), gaussians, iterations);
        if let Some(policy) = &policy {
            fit = fit.with_policy(policy.named()?);
        }
        let fit = settings::with("settings", fit, settings)?;
        fit.validate().map_err(IntoPython::into_python)?;
        let shared = Arc::new(Shared::default());
        let own = own_policy(policy, fit.policy.actions(), &shared)?.map(|own| own as ForeignPolicy);
        let (on, iterations) = (chosen.clone(), fit.iterations);
        let worker = Worker::spawn(shared, move |reporter| {
            let rasterizer = backend::rasterizer(&on);
            let mut trainer = match &checkpoint {
                Some(path) if path.is_file() => Trainer::resume(rasterizer, &target, gs_io::read_checkpoint(path)?)?,
                _ => block_on(Trainer::new(rasterizer, &target, fit))?,
            };
            if let Some(own) = own {
                trainer = trainer.controlled_by(own);
            }
            conducted(&mut trainer, reporter, checkpoint.as_ref())?;
            let (image, culled) = block_on(trainer.render())?;
            let summary = block_on(FitSummary::new(&trainer, &image, culled))?;
            Ok(FitDone { scene: block_on(trainer.scene())?, render: trainer.shown(), image, summary })
        })?;
        Ok(Self { worker, backend: chosen, iterations })
    }

    fn __iter__(this: Py<Self>) -> Py<Self> {
        this
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Progress>> {
        self.worker.next(py)
    }

    /// Number of steps.
    fn __len__(&self) -> usize {
        self.iterations as usize
    }

    /// Stops the run at its next step.
    fn stop(&self) {
        self.worker.shared.stops.store(true, Relaxed);
    }

    /// Waits for the end.
    fn result(&self, py: Python<'_>) -> PyResult<Fit> {
        let done = self.worker.result(py)?;
        let mut scene = Scene2d::of(done.scene.clone());
        scene.size = Some(done.image.size());
        scene.render = Some(done.render);
        let image = arrays::of_image(py, &done.image)?;
        let summary = settings::to_python(py, &done.summary)?;
        summary.set_item("psnr", done.summary.psnr)?;
        Ok(Fit {
            scene: Py::new(py, scene)?,
            image: image.unbind(),
            summary: summary.unbind(),
            psnr: done.summary.psnr,
        })
    }

    fn __repr__(&self) -> String {
        format!("<FitRun of {} steps on {}>", self.iterations, self.backend.rasterizer.name())
    }
}

/// The policy of an object in Python, where it is one.
fn own_policy(
    policy: Option<PolicyArgument<'_>>,
    actions: Option<&gs_density::Actions>,
    shared: &Shared,
) -> PyResult<Option<Arc<PythonPolicy>>> {
    let Some(PolicyArgument::InPython(object)) = policy else { return Ok(None) };
    let actions = actions.copied().unwrap_or_default();
    PythonPolicy::new(&object, actions, shared.raised.clone()).map(Arc::new).map(Some)
}

/// The image of an array or of a file.
fn target(py: Python<'_>, image: &Bound<'_, PyAny>) -> PyResult<Image> {
    match image.extract::<PathBuf>() {
        Ok(path) => Ok(py.detach(|| gs_io::read_image(path)).map_err(IntoPython::into_python)?.image),
        Err(_) => arrays::image("image", image),
    }
}

/// The result of a fit.
#[pyclass(frozen, module = "gaussian_splats", get_all)]
#[derive(Debug)]
pub(crate) struct Fit {
    scene: Py<Scene2d>,
    image: Py<PyArray3<f32>>,
    summary: Py<PyAny>,
    psnr: f64,
}

#[pymethods]
impl Fit {
    fn __repr__(&self) -> String {
        format!("<Fit: {:.2} dB with {} Gaussians>", self.psnr, self.scene.get().scene.means.len())
    }

    /// The rendering as PNG, for notebooks.
    fn _repr_png_(&self, py: Python<'_>) -> PyResult<Vec<u8>> {
        let image = arrays::image("image", self.image.bind(py).as_any())?;
        Ok(py.detach(|| gs_io::png_bytes(&image)))
    }
}

/// What a training ends with.
struct TrainDone {
    scene: CoreScene3d,
    render: gs_core::RenderSettings,
    summary: TrainSummary,
}

/// A training under way.
#[pyclass(frozen, module = "gaussian_splats")]
pub(crate) struct TrainRun {
    worker: Worker<TrainDone>,
    iterations: u32,
}

#[pymethods]
impl TrainRun {
    #[new]
    #[pyo3(signature = (dataset, gaussians = None, *, preset = "standard", iterations = None, start = None, reading = None, policy = None, settings = None, backend = None, checkpoint = None))]
    #[allow(clippy::too_many_arguments, reason = "keyword arguments")]
    fn new(
        py: Python<'_>,
        dataset: PathBuf,
        gaussians: Option<u32>,
        preset: &str,
        iterations: Option<u32>,
        start: Option<&str>,
        reading: Option<&Bound<'_, PyDict>>,
        policy: Option<&Bound<'_, PyAny>>,
        settings: Option<&Bound<'_, PyDict>>,
        backend: Option<&Bound<'_, Backend>>,
        checkpoint: Option<PathBuf>,
    ) -> PyResult<Self> {
        let reading = settings::with("reading", DatasetReading::default(), reading)?;
        let dataset = py.detach(|| reading.read(&dataset)).map_err(IntoPython::into_python)?;
        let chosen = backend::chosen(py, backend)?;
        let preset: TrainPreset = settings::named("preset", preset)?;
        let policy = policy.map(PolicyArgument::of).transpose()?;
        let cameras = dataset.views_of(Split::Train).map(|view| &view.camera);
        let mut train = preset.settings_for(iterations, cameras).on(dataset.kind.background());
        if let Some(gaussians) = gaussians {
            train.gaussians = gaussians;
        }
        if let Some(policy) = &policy {
            train = train.with_policy(policy.named()?);
        }
        let train: TrainSettings = settings::with("settings", train, settings)?;
        train.validate().map_err(IntoPython::into_python)?;
        let start = match start {
            Some(name) => settings::named("start", name)?,
            None => StartName::usual(&dataset),
        };
        let start = start.of(&dataset).map_err(IntoPython::into_python)?;
        let shared = Arc::new(Shared::default());
        let own = own_policy(policy, train.policy.actions(), &shared)?.map(|own| own as ForeignPolicy<CoreScene3d>);
        let iterations = train.iterations;
        let worker = Worker::spawn(shared, move |reporter| {
            let rasterizer = backend::rasterizer(&chosen);
            let views = Views::of_dataset(&dataset);
            let mut trainer = match &checkpoint {
                Some(path) if path.is_file() => {
                    Trainer3d::resume_views(rasterizer, views, gs_io::read_checkpoint(path)?)?
                }
                _ => block_on(Trainer3d::from_views(rasterizer, views, start, train))?,
            };
            if let Some(own) = own {
                trainer = trainer.controlled_by(own);
            }
            conducted(&mut trainer, reporter, checkpoint.as_ref())?;
            let evaluation = block_on(trainer.evaluate(&mut |_, _| Ok(())))?;
            let summary = block_on(TrainSummary::new(&trainer, evaluation))?;
            Ok(TrainDone { scene: block_on(trainer.scene())?, render: trainer.shown(), summary })
        })?;
        Ok(Self { worker, iterations })
    }

    fn __iter__(this: Py<Self>) -> Py<Self> {
        this
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Progress>> {
        self.worker.next(py)
    }

    /// Number of steps.
    fn __len__(&self) -> usize {
        self.iterations as usize
    }

    /// Stops the run at its next step.
    fn stop(&self) {
        self.worker.shared.stops.store(true, Relaxed);
    }

    /// Waits for the end.
    fn result(&self, py: Python<'_>) -> PyResult<Training> {
        let done = self.worker.result(py)?;
        let scene = Scene3d::of(done.scene.clone(), Some(done.render));
        let summary = settings::to_python(py, &done.summary)?;
        let psnr = done.summary.evaluation.psnr;
        Ok(Training { scene: Py::new(py, scene)?, summary: summary.unbind(), psnr })
    }

    fn __repr__(&self) -> String {
        format!("<TrainRun of {} steps>", self.iterations)
    }
}

/// The result of a training.
#[pyclass(frozen, module = "gaussian_splats", get_all)]
#[derive(Debug)]
pub(crate) struct Training {
    scene: Py<Scene3d>,
    summary: Py<PyAny>,
    psnr: f64,
}

#[pymethods]
impl Training {
    fn __repr__(&self) -> String {
        format!("<Training: {:.2} dB with {} Gaussians>", self.psnr, self.scene.get().scene.means.len())
    }
}
