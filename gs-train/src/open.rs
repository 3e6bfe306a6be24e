//! Opens whatever holds a scene: a scene file of any kind, a checkpoint, or the output folder of a fit or a training.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use gs_core::{RenderSettings, Scene2d, Scene3d, examination};
use gs_io::{Checkpoint, File2d, File3d, Format3d, TrainedWith};

use crate::{
    checkpoint::{Record, size_of_fingerprint},
    error::Error,
    task::Trainable,
    train::shown,
};

/// The files of an output folder that hold its scene, the best first.
pub const SCENE_NAMES: [&str; 3] = ["scene.gs2d.safetensors", "scene.ply", "checkpoint.safetensors"];

/// A scene that was opened.
#[derive(Debug, Clone)]
pub struct Opened {
    /// The file that holds it: the given one or, of a folder, the one that was found in it.
    pub path: PathBuf,
    /// The scene.
    pub scene: OpenedScene,
    /// What a checkpoint says of its run, by name; `None` for a scene file.
    pub run: Option<BTreeMap<String, String>>,
    /// Gaussians of a checkpoint that cannot be drawn and are left out. The next round of density control would have removed them.
    pub left_out: usize,
}

/// A scene of either kind.
#[derive(Debug, Clone)]
pub enum OpenedScene {
    /// A 2D scene, its size and how it is shown.
    TwoD(Box<File2d>),
    /// A 3D scene.
    ThreeD {
        /// The scene.
        file: Box<File3d>,
        /// How it is shown, where that is known: a checkpoint says it.
        shown: Option<RenderSettings>,
    },
}

/// Whether values that cannot be drawn are an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Values {
    /// They are; those of a checkpoint are left out.
    Checked,
    /// They are not: for who examines or mends a scene.
    Any,
}

/// Whether a path is meant to hold a scene, and not, say, an image: a folder, or a file that is a scene or a checkpoint by its content or
/// by its name.
///
/// # Errors
/// Where there is no such file, or it cannot be read.
pub fn is_scene(path: &Path) -> Result<bool, Error> {
    let named = path.extension().is_some_and(|ending| ending == "safetensors") || Format3d::to_write(path).is_some();
    Ok(path.is_dir()
        || gs_io::format_3d(path)?.is_some()
        || named
        || gs_io::is_scene(path)
        || gs_io::is_checkpoint(path))
}

/// Opens what holds a scene.
///
/// # Errors
/// [`Error::NoScene`] for a folder without one; those of [`gs_io::read_scene`], [`gs_io::read_3d`] and [`gs_io::read_checkpoint`];
/// [`Error::Checkpoint`] and [`gs_core::Error::State`] for a checkpoint that is not one of a fit or a training.
pub fn open_scene(path: &Path, values: Values) -> Result<Opened, Error> {
    if path.is_dir() {
        let found = scene_in(path).ok_or_else(|| Error::NoScene { path: path.to_owned() })?;
        return open_file(&found, values);
    }
    open_file(path, values)
}

/// The file of an output folder that holds its scene.
pub fn scene_in(folder: &Path) -> Option<PathBuf> {
    SCENE_NAMES.iter().map(|name| folder.join(name)).find(|file| file.is_file())
}

fn open_file(path: &Path, values: Values) -> Result<Opened, Error> {
    let opened = |scene| Ok(Opened { path: path.to_owned(), scene, run: None, left_out: 0 });
    // What is called a 3D scene is meant to be one: its reader says why it is none.
    if gs_io::format_3d(path)?.is_some() || (Format3d::to_write(path).is_some() && !gs_io::is_checkpoint(path)) {
        let file = match values {
            Values::Checked => gs_io::read_3d(path),
            Values::Any => gs_io::read_3d_unchecked(path),
        };
        return opened(OpenedScene::ThreeD { file: Box::new(file?), shown: None });
    }
    if gs_io::is_checkpoint(path) {
        return of_checkpoint(path, gs_io::read_checkpoint(path)?, values);
    }
    let file = match values {
        Values::Checked => gs_io::read_scene(path),
        Values::Any => gs_io::read_scene_unchecked(path),
    };
    opened(OpenedScene::TwoD(Box::new(file?)))
}

fn of_checkpoint(path: &Path, checkpoint: Checkpoint, values: Values) -> Result<Opened, Error> {
    let Checkpoint { state, metadata } = checkpoint;
    let broken = |source| gs_io::Error::Content { path: path.to_owned(), source };
    let (scene, left_out) = if state.is_3d() {
        let record = record_of::<Scene3d>(path, &metadata)?;
        let (scene, left_out) = sound(state.scene_3d().map_err(broken)?, values)?;
        let shown = shown(&record.settings, &record.effects());
        let bytes = std::fs::metadata(path).map_or(0, |file| file.len());
        let effects = &shown.effects;
        let trained_with = TrainedWith { antialias: Some(effects.antialias), order: Some(effects.order) };
        let (format, losses) = (Format3d::Checkpoint, Vec::new());
        let file = File3d { scene, format, bytes, beside: Vec::new(), losses, trained_with, picture: None };
        (OpenedScene::ThreeD { file: Box::new(file), shown: Some(shown) }, left_out)
    } else {
        let record = record_of::<Scene2d>(path, &metadata)?;
        let Some((width, height)) = size_of_fingerprint(&record.images) else {
            return Err(Error::Checkpoint("its metadata do not say how large the image is".to_owned()));
        };
        let (scene, left_out) = sound(state.scene_2d().map_err(broken)?, values)?;
        let settings = record.settings.render.with(|s| s.effects = record.effects());
        (OpenedScene::TwoD(Box::new(File2d { scene, width, height, settings })), left_out)
    };
    Ok(Opened { path: path.to_owned(), scene, run: Some(metadata), left_out })
}

fn record_of<S: Trainable>(path: &Path, metadata: &BTreeMap<String, String>) -> Result<Record<S::Settings>, Error> {
    Record::from_metadata::<S>(metadata).map_err(|error| match error {
        Error::Checkpoint(what) => Error::Checkpoint(format!("{}: {what}", path.display())),
        error => error,
    })
}

/// The scene without what cannot be drawn, and how much that was.
fn sound<S: examination::Examinable>(mut scene: S, values: Values) -> Result<(S, usize), Error> {
    let left_out = match values {
        Values::Checked => examination::repair(&mut scene)?.removed,
        Values::Any => 0,
    };
    Ok((scene, left_out))
}
