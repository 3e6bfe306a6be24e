//! `FitRun` and `Fit`: a fit of an image, and its result.

use std::{path::PathBuf, sync::Arc};

use gs_backend::block_on;
use gs_core::Image;
use gs_train::{CustomPolicy, FitSettings, FitSummary, Preset, SettingsFile as _, Trainer};
use numpy::PyArray3;
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
        arrays,
        errors::IntoPython,
        settings::{self, Given},
    },
    density::policy::PolicyArgument,
    scene::scene2d::Scene2d,
};

/// What a fit ends with.
struct FitDone {
    scene: gs_core::Scene2d,
    render: gs_core::RenderSettings,
    image: Image,
    summary: FitSummary,
}

#[doc = doc!("FitRun")]
#[pyclass(frozen, module = "gaussian_splats")]
pub(crate) struct FitRun {
    worker: Worker<FitDone>,
    steps: u32,
}

#[pymethods]
impl FitRun {
    #[new]
    #[pyo3(signature = (image, gaussians = None, *, preset = None, iterations = None, policy = None, settings = None, backend = None, checkpoint = None))]
    #[allow(clippy::too_many_arguments, reason = "keyword arguments")]
    fn new(
        py: Python<'_>,
        image: &Bound<'_, PyAny>,
        gaussians: Option<u32>,
        preset: Option<&str>,
        iterations: Option<u32>,
        policy: Option<&Bound<'_, PyAny>>,
        settings: Option<&Bound<'_, PyAny>>,
        backend: Option<&Bound<'_, PyAny>>,
        checkpoint: Option<PathBuf>,
    ) -> PyResult<Self> {
        let target = arrays::image_or_file(py, "image", image)?;
        let chosen = backend::chosen(py, backend)?;
        let policy = policy.map(PolicyArgument::of).transpose()?;
        let given = Given::of("settings", preset, settings)?;
        let fit = wanted(&target, gaussians, iterations, policy.as_ref(), given)?;
        let start = Start::read(py, checkpoint)?;
        let steps = fit.iterations.saturating_sub(start.step());
        let shared = Arc::new(Shared::default());
        let own = own_policy(policy, fit.policy.actions(), &shared)?.map(|own| own as CustomPolicy);
        let worker = Worker::spawn(shared, move |reporter| {
            chosen.within(|rasterizer| {
                let mut trainer = match start.checkpoint {
                    Some(checkpoint) => {
                        let trainer = Trainer::resume(rasterizer, &target, checkpoint)?;
                        check_settings(trainer.settings(), &fit)?;
                        trainer
                    }
                    None => block_on(Trainer::new(rasterizer, &target, fit))?,
                };
                if let Some(own) = own {
                    trainer = trainer.controlled_by(own);
                }
                conduct(&mut trainer, reporter, start.file.as_deref())?;
                let (image, culled) = block_on(trainer.render())?;
                let summary = block_on(FitSummary::new(&trainer, &image, culled))?;
                Ok(FitDone { scene: block_on(trainer.scene())?, render: trainer.shown(), image, summary })
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

    #[doc = doc!("FitRun.stop")]
    fn stop(&self) {
        self.worker.stop();
    }

    #[doc = doc!("FitRun.result")]
    fn result(&self, py: Python<'_>) -> PyResult<Fit> {
        let (done, history) = &*self.worker.result(py)?;
        let mut scene = Scene2d::of(done.scene.clone());
        scene.size = Some(done.image.size());
        scene.render = Some(done.render);
        let image = arrays::of_image(py, &done.image)?;
        let summary = settings::to_python(py, &done.summary)?;
        // JSON has no infinity.
        summary.set_item("psnr", done.summary.psnr)?;
        Ok(Fit {
            scene: Py::new(py, scene)?,
            image: image.unbind(),
            summary: summary.unbind(),
            history: history.to_python(py)?.unbind(),
            psnr: done.summary.psnr,
        })
    }

    fn __repr__(&self) -> String {
        format!("<FitRun of {} steps>", self.steps)
    }
}

/// The settings that the arguments ask for, for this target.
fn wanted(
    target: &Image,
    gaussians: Option<u32>,
    iterations: Option<u32>,
    policy: Option<&PolicyArgument<'_>>,
    given: Given<'_>,
) -> PyResult<FitSettings> {
    let mut fit = match &given {
        Given::File(file) => {
            let fit = FitSettings::from_toml(&settings::text_of(file)?, file).map_err(IntoPython::into_python)?;
            let (gaussians, iterations) = (gaussians.unwrap_or(fit.gaussians), iterations.unwrap_or(fit.iterations));
            fit.with_gaussians(gaussians).with_iterations(iterations)
        }
        Given::Preset { name, .. } => {
            let preset: Preset = settings::named("preset", name)?;
            FitSettings::from_preset(preset, target.size(), gaussians, iterations)
        }
    };
    if let Some(policy) = policy {
        fit = fit.with_policy(policy.named()?);
    }
    if let Given::Preset { changes, .. } = &given {
        fit = settings::with("settings", fit, changes.as_ref())?.before_flat_color(target);
    }
    fit.validate().map_err(IntoPython::into_python)?;
    Ok(fit)
}

#[doc = doc!("Fit")]
#[pyclass(frozen, module = "gaussian_splats", get_all)]
#[derive(Debug)]
pub(crate) struct Fit {
    #[doc = doc!("Fit.scene")]
    scene: Py<Scene2d>,
    #[doc = doc!("Fit.image")]
    image: Py<PyArray3<f32>>,
    #[doc = doc!("Fit.summary")]
    summary: Py<PyAny>,
    #[doc = doc!("Fit.history")]
    history: Py<PyDict>,
    #[doc = doc!("Fit.psnr")]
    psnr: f64,
}

#[pymethods]
impl Fit {
    fn __repr__(&self) -> String {
        format!("<Fit: {:.2} dB with {} Gaussians>", self.psnr, self.scene.get().scene.means.len())
    }

    #[doc = doc!("Fit._repr_png_")]
    fn _repr_png_<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let image = arrays::image("image", self.image.bind(py).as_any())?;
        Ok(PyBytes::new(py, &gs_io::png_bytes(&image)))
    }
}
