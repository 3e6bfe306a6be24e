//! `Scene3d`: the Gaussians of a 3D scene.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use bytemuck::cast_slice;
use glam::Vec3;
use gs_backend::block_on;
use gs_core::{LodNode, Rasterizer as _, RenderSettings, Scene as _, math::sh, view::Bulk};
use gs_io::{
    AnyScene, Done, Edit, File3d, LodFile3d, TrainedWith, Values as AllowedValues, WorldFrame, WriteOptions3d,
};
use gs_train::{edit::ViewEditor, train::Views};
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::{
    IntoPyObjectExt,
    prelude::*,
    types::{PyAny, PyBytes, PyDict},
};

use super::{camera::Camera, scene2d::Scene2d};
use crate::{
    backend,
    convert::{
        arrays::{self, Side, Values},
        dataset::read_dataset,
        errors::{self, IntoPython},
    },
};

#[doc = doc!("Scene3d")]
#[pyclass(frozen, module = "gaussian_splats")]
#[derive(Debug)]
pub(crate) struct Scene3d {
    pub(crate) scene: Arc<gs_core::Scene3d>,
    /// How the scene was trained, as far as that is known.
    trained_with: TrainedWith,
    /// All settings that the scene is rendered with, where they are known.
    settings: Option<RenderSettings>,
}

impl Scene3d {
    pub(crate) fn of(scene: gs_core::Scene3d, settings: Option<RenderSettings>, frame: WorldFrame) -> Self {
        let trained_with = TrainedWith::default().with(|trained| {
            trained.antialias = settings.map(|settings| settings.effects.antialias);
            trained.order = settings.map(|settings| settings.effects.order);
            trained.frame = frame;
        });
        Self { scene: Arc::new(scene), trained_with, settings }
    }

    /// The scene of a file.
    fn of_file(File3d { scene, trained_with, settings, .. }: File3d) -> Self {
        Self { scene: Arc::new(scene), trained_with, settings }
    }

    /// The frame of the scene.
    pub(crate) fn frame(&self) -> WorldFrame {
        self.trained_with.frame
    }

    /// The scene in another frame.
    pub(crate) fn in_frame(&self, frame: WorldFrame) -> gs_core::Scene3d {
        let mut scene = gs_core::Scene3d::clone(&self.scene);
        gs_io::move_scene(&mut scene, &self.trained_with.frame, &frame);
        scene
    }

    /// How the scene is to be rendered: as it was trained, completed by what 3DGS uses, before this
    /// background unless it has one.
    pub(crate) fn render(&self, background: [f32; 3]) -> RenderSettings {
        self.settings.unwrap_or_else(|| self.trained_with.render_settings(self.scene.sh_degree, background))
    }

    /// The scene from a little above as PNG; `None` where nothing of it can be seen.
    pub(crate) fn png<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyBytes>>> {
        let Some(camera) = overview(&self.scene, 480, 360) else { return Ok(None) };
        let (scene, settings) = (self.scene.clone(), self.render([0.0; 3]));
        let image = backend::chosen(py, None)?.compute(py, |on| block_on(on.render(&*scene, &camera, &settings)))?;
        Ok(Some(PyBytes::new(py, &gs_io::png_bytes(&image))))
    }
}

#[pymethods]
impl Scene3d {
    #[new]
    fn new(
        means: &Bound<'_, PyAny>,
        log_scales: &Bound<'_, PyAny>,
        rotations: &Bound<'_, PyAny>,
        opacity_logits: &Bound<'_, PyAny>,
        sh: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let (means, shape) = arrays::floats("means", means, &[Side::Any("N"), Side::Exactly(3)], Values::Finite)?;
        let n = Side::Exactly(shape[0]);
        let (sh, sh_shape) = arrays::floats("sh", sh, &[n, Side::Any("K"), Side::Exactly(3)], Values::Finite)?;
        let Some(sh_degree) = (0..=3).find(|&degree| sh::coefficients(degree) == sh_shape[1]) else {
            let problem = format!("expected 1, 4, 9 or 16 coefficients, not {}", sh_shape[1]);
            return Err(errors::value("sh", problem));
        };
        let scene = gs_core::Scene3d {
            means: cast_slice(&means).to_vec(),
            log_scales: cast_slice(&arrays::finite("log_scales", log_scales, &[n, Side::Exactly(3)])?).to_vec(),
            rotations: cast_slice(&arrays::finite("rotations", rotations, &[n, Side::Exactly(4)])?).to_vec(),
            opacity_logits: arrays::floats("opacity_logits", opacity_logits, &[n], Values::Infinite)?.0,
            sh_degree,
            sh: cast_slice(&sh).to_vec(),
        };
        scene.validate().map_err(IntoPython::into_python)?;
        Ok(Self::of(scene, None, WorldFrame::WORLD))
    }

    #[doc = doc!("Scene3d.means")]
    #[getter]
    fn means<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let scene = &this.get().scene;
        arrays::view(this.clone().into_any(), [scene.len(), 3], cast_slice(&scene.means))
    }

    #[doc = doc!("Scene3d.log_scales")]
    #[getter]
    fn log_scales<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let scene = &this.get().scene;
        arrays::view(this.clone().into_any(), [scene.len(), 3], cast_slice(&scene.log_scales))
    }

    #[doc = doc!("Scene3d.rotations")]
    #[getter]
    fn rotations<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let scene = &this.get().scene;
        arrays::view(this.clone().into_any(), [scene.len(), 4], cast_slice(&scene.rotations))
    }

    #[doc = doc!("Scene3d.opacity_logits")]
    #[getter]
    fn opacity_logits<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray1<f32>>> {
        let scene = &this.get().scene;
        arrays::view(this.clone().into_any(), [scene.len()], &scene.opacity_logits)
    }

    #[doc = doc!("Scene3d.sh")]
    #[getter]
    fn sh<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let scene = &this.get().scene;
        arrays::view(this.clone().into_any(), [scene.len(), scene.sh_len(), 3], cast_slice(&scene.sh))
    }

    #[doc = doc!("Scene3d.arrays")]
    #[getter]
    fn arrays<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyDict>> {
        arrays::by_name(this.as_any(), &["means", "log_scales", "rotations", "opacity_logits", "sh"])
    }

    #[doc = doc!("Scene3d.frame")]
    #[getter(frame)]
    fn frame_of(&self) -> ([f64; 3], f64) {
        let WorldFrame { origin, unit } = self.frame();
        (origin.to_array(), unit)
    }

    #[doc = doc!("Scene3d.sh_degree")]
    #[getter]
    fn sh_degree(&self) -> u8 {
        self.scene.sh_degree
    }

    fn __len__(&self) -> usize {
        self.scene.len()
    }

    fn __repr__(&self) -> String {
        format!("<Scene3d, {} Gaussians of SH degree {}>", self.scene.len(), self.scene.sh_degree)
    }

    #[doc = doc!("Scene3d.save")]
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let options = WriteOptions3d::default().with(|options| options.trained_with = self.trained_with);
        errors::computed(py, || gs_io::write_3d(path, &self.scene, &options).map(drop))
    }

    #[doc = doc!("Scene3d.edited")]
    #[pyo3(signature = (*operations, dataset = None, reading = None, backend = None))]
    fn edited(
        &self,
        py: Python<'_>,
        operations: Vec<String>,
        dataset: Option<PathBuf>,
        reading: Option<&Bound<'_, PyAny>>,
        backend: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let parse = |text: &String| text.parse::<Edit>().map_err(|error| errors::value(text, error));
        let edits = operations.iter().map(parse).collect::<PyResult<Vec<_>>>()?;
        let (mut scene, mut trained_with) = ((*self.scene).clone(), self.trained_with);
        let frame = &mut trained_with.frame;
        if let Some(dataset) = dataset {
            let dataset = read_dataset(py, &dataset, reading, Some(self.frame()))?;
            let render = self.render(dataset.kind.background());
            backend::chosen(py, backend)?.compute_within(py, |on| {
                let mut editor = ViewEditor::new(on, Views::of_dataset(&dataset).cached(), render);
                edits.iter().try_for_each(|edit| {
                    block_on(editor.apply(edit, &mut scene, frame))?.check()?;
                    Ok::<_, gs_train::Error>(())
                })
            })?;
        } else {
            errors::computed(py, || {
                edits.iter().zip(&operations).try_for_each(|(edit, text)| {
                    let done = edit.apply(&mut scene, frame).and_then(Done::check);
                    done.map(drop).map_err(|error| (text.as_str(), error))
                })
            })?;
        }
        Ok(Self { scene: Arc::new(scene), trained_with, settings: self.settings })
    }

    #[doc = doc!("Scene3d._repr_png_")]
    fn _repr_png_<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyBytes>>> {
        self.png(py)
    }
}

#[doc = doc!("load")]
#[pyfunction]
#[pyo3(signature = (path, *, cameras = None, max_gaussians = None))]
pub(crate) fn load(
    py: Python<'_>,
    path: PathBuf,
    cameras: Option<&Bound<'_, PyAny>>,
    max_gaussians: Option<u32>,
) -> PyResult<Py<PyAny>> {
    if let Some(cameras) = cameras {
        return Scene3d::of_file(levels(py, &path, cameras, max_gaussians)?).into_py_any(py);
    }
    if max_gaussians.is_some() {
        return Err(errors::value("max_gaussians", "needs cameras, for which the levels of detail are chosen"));
    }
    let file = errors::computed(py, || gs_io::read_scene(path, AllowedValues::Checked))?;
    match file.scene {
        AnyScene::TwoD(file) => Scene2d::of_file(*file).into_py_any(py),
        AnyScene::ThreeD(file) => Scene3d::of_file(*file).into_py_any(py),
    }
}

/// Reads the levels of detail that these cameras need.
fn levels(py: Python<'_>, path: &Path, cameras: &Bound<'_, PyAny>, max_gaussians: Option<u32>) -> PyResult<File3d> {
    let Ok(cameras) = cameras.extract::<Vec<Bound<'_, Camera>>>() else {
        return Err(errors::wrong_type("cameras", "a sequence of Camera", cameras));
    };
    if max_gaussians == Some(0) {
        return Err(errors::value("max_gaussians", "at least 1"));
    }
    let cameras: Vec<_> = cameras.iter().map(|camera| camera.get().camera).collect();
    let budget = max_gaussians.map_or(usize::MAX, |most| most as usize);
    let found = if path.is_dir() { gs_io::readable_in(path) } else { None };
    let path = found.as_deref().unwrap_or(path);
    let Some(file) = errors::computed(py, || LodFile3d::open(path))? else {
        let problem = format!(
            "{} has no levels of detail, which scene.save(\"FOLDER/lod-meta.json\") and scene.save(\"SCENE.rad\") write",
            path.display()
        );
        return Err(errors::value("cameras", problem));
    };
    let cut = errors::computed(py, || file.tree().cut(&cameras, budget, LodNode::USUAL_ERROR_PX))?;
    if cut.gaussians > budget {
        let note = format!("max_gaussians: the coarsest levels have {} Gaussians", cut.gaussians);
        py.import("warnings")?.call_method1("warn", (note,))?;
    }
    errors::computed(py, || file.read(&cut.levels))
}

/// A camera slightly above a scene that has most of it in view.
pub(super) fn overview(scene: &gs_core::Scene3d, width: u32, height: u32) -> Option<gs_core::Camera> {
    Bulk::of(scene)?.overview(width, height, Bulk::FIELD_OF_VIEW, Vec3::NEG_Y)
}
