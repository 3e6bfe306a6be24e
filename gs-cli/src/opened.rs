//! Opens the scene that a command is given, and prints what is worth knowing about it.

use std::path::{Path, PathBuf};

use gs_core::{RenderSettings, counted};
use gs_io::{File2d, File3d, dataset::Dataset};
use gs_train::{Error, Opened, OpenedScene, Values, open_scene, scene_in};

use crate::{failure::Failure, memory, output, shown::ShownArgs};

/// Opens a scene file, a checkpoint or an output folder, and says which file of a folder it took.
///
/// # Errors
/// Where there is no scene, or it cannot be read.
pub(crate) fn open(path: &Path, values: Values) -> Result<Opened, Failure> {
    let file = file_of(path);
    if !file.is_dir() {
        memory::check_3d(&file)?;
    }
    let opened = open_scene(path, values).map_err(|error| match error {
        Error::Io(error) => Failure::of_scene(error),
        error => error.into(),
    })?;
    if opened.path != path {
        output::note(format_args!("opened {}", opened.path.display()));
    }
    if opened.left_out > 0 {
        output::note(format_args!("note: left out as not finite: {}", counted(opened.left_out, "Gaussian")));
    }
    Ok(opened)
}

/// The file that a command reads where it is given this path: of a folder, the one that holds its scene.
pub(crate) fn file_of(path: &Path) -> PathBuf {
    let found = if path.is_dir() { scene_in(path) } else { None };
    found.unwrap_or_else(|| path.to_owned())
}

/// A 3D scene, and how it is shown where its file says that.
#[derive(Debug)]
pub(crate) struct Opened3d {
    pub(crate) file: File3d,
    shown: Option<RenderSettings>,
}

/// A scene of either kind.
pub(crate) enum Scene {
    TwoD(File2d),
    ThreeD(Opened3d),
}

/// Opens a scene of either kind whose values are all possible.
///
/// # Errors
/// Those of [`open`].
pub(crate) fn scene(path: &Path) -> Result<Scene, Failure> {
    Ok(match open(path, Values::Checked)?.scene {
        OpenedScene::TwoD(file) => Scene::TwoD(*file),
        OpenedScene::ThreeD { file, shown } => Scene::ThreeD(Opened3d { file: *file, shown }),
    })
}

/// Opens a 3D scene.
///
/// # Errors
/// Those of [`open`]; bad usage for a 2D scene.
pub(crate) fn scene_3d(path: &Path) -> Result<Opened3d, Failure> {
    match scene(path)? {
        Scene::ThreeD(scene_3d) => Ok(scene_3d),
        Scene::TwoD(_) => Err(Failure::usage("is a 2D scene, but a 3D scene is needed").at(path.display())),
    }
}

impl Opened3d {
    /// How the scene is shown: as the flags say, or else as its file says, or else as is usual, beside a data set if there is one.
    pub(crate) fn settings(&self, flags: &ShownArgs, dataset: Option<&Dataset>) -> RenderSettings {
        match (self.shown, dataset) {
            (Some(known), _) => flags.settings_known(&self.file.scene, known),
            (None, Some(dataset)) => flags.settings_beside(&self.file.scene, self.file.trained_with, dataset),
            (None, None) => flags.settings(&self.file.scene, self.file.trained_with),
        }
    }

    /// Notes on standard error that the antialiasing is a guess, where neither the file nor a flag says it.
    pub(crate) fn note_guess(&self, flags: &ShownArgs) {
        flags.note_guess(self.file.trained_with);
    }
}
