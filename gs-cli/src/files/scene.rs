//! Reads the scene that a command is given, and says what is worth knowing about it.

use std::path::{Path, PathBuf};

use gs_core::counted;
use gs_io::{AnyScene, File3d, SCENE_EXTENSION, SceneFile, Values, is_scene, read_scene, readable_in};

use crate::{failure::Failure, memory, terminal::output};

/// Reads a scene file, a checkpoint or an output folder, and names the file that it took from a
/// folder.
pub(crate) fn read(path: &Path, values: Values) -> Result<SceneFile, Failure> {
    let file = file_of(path);
    if !file.is_dir() {
        memory::check_3d(&file)?;
    }
    let scene = read_scene(path, values).map_err(Failure::of_scene)?;
    if scene.path != path {
        output::note(format_args!("opened {}", scene.path.display()));
    }
    if scene.left_out > 0 {
        output::note(format_args!("note: left out as not finite: {}", counted(scene.left_out, "Gaussian")));
    }
    Ok(scene)
}

/// The file that a command reads if it is given this path: in a folder, the one that holds its
/// scene.
pub(crate) fn file_of(path: &Path) -> PathBuf {
    let found = if path.is_dir() { readable_in(path) } else { None };
    found.unwrap_or_else(|| path.to_owned())
}

/// Whether a path has the extension of a 2D scene file.
pub(crate) fn is_scene_2d(path: &Path) -> bool {
    path.file_name()
        .is_some_and(|name| name.to_string_lossy().to_ascii_lowercase().ends_with(&format!(".{SCENE_EXTENSION}")))
}

/// Reads a scene of either kind whose values are all possible.
pub(crate) fn read_any(path: &Path) -> Result<AnyScene, Failure> {
    Ok(read(path, Values::Checked)?.scene)
}

/// Reads a scene of either kind; `None` for another file, such as an image.
pub(crate) fn read_if_any(path: &Path) -> Result<Option<AnyScene>, Failure> {
    is_scene(path)?.then(|| read_any(path)).transpose()
}

/// Reads a 3D scene.
pub(crate) fn read_3d(path: &Path) -> Result<File3d, Failure> {
    match read_any(path)? {
        AnyScene::ThreeD(file) => Ok(*file),
        AnyScene::TwoD(_) => Err(Failure::usage("is a 2D scene, but a 3D scene is needed").at(path.display())),
    }
}
