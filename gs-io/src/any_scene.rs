//! Reading the scene of a path: a scene file of any format, a checkpoint, or the output folder of a
//! fit or a training.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use gs_codec::Extent;
use gs_core::{
    RenderSettings, SplatsState,
    effects::Statistics,
    examination::{self, Examinable},
};
use serde::Deserialize;

use crate::{
    WorldFrame,
    checkpoint::{Checkpoint, decode_checkpoint, is_checkpoint, read_checkpoint},
    dataset::Dataset,
    error::Error,
    scene2d::{File2d, GSI_EXTENSION, decode_2d, decode_gsi, is_2d, is_gsi, read_2d, read_2d_unchecked, read_gsi},
    scene3d::{self, File3d, Format3d, TrainedWith, foreign, format_3d, read_3d, read_3d_unchecked},
};

/// The entry of a checkpoint's metadata with its [`WorldFrame`]; absent for the world itself.
pub const FRAME_ENTRY: &str = "frame";

/// The files of an output folder that hold its scene, in the order of preference.
const SCENE_NAMES: [&str; 5] =
    ["scene.gs2d.safetensors", "scene.ply", "checkpoint.safetensors", "lod-meta.json", "meta.json"];

/// A scene that [`read_scene`] has read.
#[derive(Debug, Clone)]
pub struct SceneFile {
    /// The file that holds the scene: the given one, or the one that was found in the given folder.
    pub path: PathBuf,
    /// The scene.
    pub scene: AnyScene,
    /// The metadata of a checkpoint; `None` for a scene file.
    pub metadata: Option<BTreeMap<String, String>>,
    /// Gaussians of a checkpoint that cannot be drawn and are left out. The next round of density
    /// control would have removed them.
    pub left_out: usize,
    /// Whether the file has alpha; the scene is the picture on white then.
    pub has_alpha: bool,
}

/// A scene of either kind.
#[derive(Debug, Clone)]
pub enum AnyScene {
    /// A 2D scene.
    TwoD(Box<File2d>),
    /// A 3D scene.
    ThreeD(Box<File3d>),
}

/// Whether values that cannot be drawn are an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Values {
    /// An error in scene files; left out of checkpoints.
    Checked,
    /// Allowed, for programs that examine or repair a scene.
    Any,
}

/// Whether a path names a scene rather than, say, an image: a folder, or a file that is a scene or
/// a checkpoint by its content or by its name.
///
/// # Errors
/// Where there is no such file, or it cannot be read.
pub fn is_scene(path: impl AsRef<Path>) -> Result<bool, Error> {
    let path = path.as_ref();
    let named = path.extension().is_some_and(|ending| ending == "safetensors") || Format3d::to_write(path).is_some();
    Ok(path.is_dir() || format_3d(path)?.is_some() || named || is_gsi(path) || is_2d(path) || is_checkpoint(path))
}

/// Reads a scene, 2D or 3D, from a scene file, a checkpoint, or the output folder of a fit or a
/// training.
///
/// # Errors
/// - [`Error::Unusable`] for a folder without a scene, and a kind of scene that cannot be read.
/// - [`Error::Content`] for a checkpoint whose metadata do not say how its scene is rendered.
/// - Those of [`read_2d`], [`read_gsi`], [`read_3d`] and [`read_checkpoint`].
pub fn read_scene(path: impl AsRef<Path>, values: Values) -> Result<SceneFile, Error> {
    let path = path.as_ref();
    if !path.is_dir() {
        return read_file(path, values);
    }
    let none = || format!("holds no scene: looked for {}", SCENE_NAMES.join(", "));
    let found = readable_in(path).ok_or_else(|| Error::unusable(path, none(), "name the scene's file"))?;
    read_file(&found, values)
}

/// Decodes the bytes of a scene file or a checkpoint, as [`read_scene`] with [`Values::Checked`] reads
/// it. `name` is its name, which decides where the content doesn't.
///
/// # Errors
/// Those of [`read_scene`] that concern the content.
pub fn decode_scene(bytes: &[u8], name: &Path) -> Result<AnyScene, Error> {
    if gs_codec::is_gsi(bytes) || name.extension().is_some_and(|ending| ending == GSI_EXTENSION) {
        let file = decode_gsi(bytes, Extent::Whole);
        let file = file.map_err(|source| Error::Compressed { path: name.to_owned(), source })?;
        return Ok(AnyScene::TwoD(Box::new(file.on([1.0; 3]))));
    }
    if let Ok(checkpoint) = decode_checkpoint(bytes, name) {
        return of_checkpoint(name, checkpoint, Values::Checked).map(|file| file.scene);
    }
    if name.extension().is_some_and(|ending| ending == "safetensors") {
        return Ok(AnyScene::TwoD(Box::new(decode_2d(bytes, name)?)));
    }
    Ok(AnyScene::ThreeD(Box::new(scene3d::checked(scene3d::decode_recognised(bytes, name)?, name)?)))
}

/// The file of an output folder that holds its scene.
pub fn scene_in(folder: impl AsRef<Path>) -> Option<PathBuf> {
    SCENE_NAMES.iter().map(|name| folder.as_ref().join(name)).find(|file| file.is_file())
}

/// The file of a folder that [`read_scene`] opens: that of [`scene_in`], or a file that describes a
/// scene of many files, which is an error that names its kind.
pub fn readable_in(folder: impl AsRef<Path>) -> Option<PathBuf> {
    let foreign = foreign::FOLDER_NAMES.map(|name| folder.as_ref().join(name));
    scene_in(folder).or_else(|| foreign.into_iter().find(|file| file.is_file()))
}

fn read_file(path: &Path, values: Values) -> Result<SceneFile, Error> {
    let of = |scene| Ok(SceneFile { path: path.to_owned(), scene, metadata: None, left_out: 0, has_alpha: false });
    if is_gsi(path) {
        let file = read_gsi(path, Extent::Whole)?;
        let has_alpha = file.alpha.is_some();
        return Ok(SceneFile { has_alpha, ..of(AnyScene::TwoD(Box::new(file.on([1.0; 3]))))? });
    }
    // A file with the name of a 3D scene is read as one, so that the reader says what is wrong with
    // it.
    if format_3d(path)?.is_some() || (Format3d::to_write(path).is_some() && !is_checkpoint(path)) {
        let file = match values {
            Values::Checked => read_3d(path),
            Values::Any => read_3d_unchecked(path),
        };
        return of(AnyScene::ThreeD(Box::new(file?)));
    }
    if is_checkpoint(path) {
        return of_checkpoint(path, read_checkpoint(path)?, values);
    }
    let file = match values {
        Values::Checked => read_2d(path),
        Values::Any => read_2d_unchecked(path),
    };
    of(AnyScene::TwoD(Box::new(file?)))
}

/// The entries of a checkpoint's settings that say how its scene is rendered. gs-train writes them.
#[derive(Debug, Default, Deserialize)]
struct Trained {
    #[serde(default)]
    render: RenderSettings,
}

impl Trained {
    /// The settings to render with. Effects that only training needs are off.
    fn render_settings(self) -> RenderSettings {
        let mut render = self.render;
        render.effects.statistics = Statistics::None;
        render
    }
}

fn of_checkpoint(path: &Path, checkpoint: Checkpoint, values: Values) -> Result<SceneFile, Error> {
    let Checkpoint { state, metadata } = checkpoint;
    let broken = Error::content(path);
    let unusable = |why: String| broken(gs_core::Error::State(format!("the checkpoint cannot be used: {why}")));
    let entry = |key: &str| metadata.get(key).ok_or_else(|| unusable(format!("its metadata lack `{key}`")));
    let trained: Trained =
        toml::from_str(entry("settings")?).map_err(|error| unusable(format!("its `settings`: {}", error.message())))?;
    let settings = trained.render_settings();
    settings.validate().map_err(&broken)?;
    let (scene, left_out) = if state.is_3d() {
        let (scene, left_out) =
            without_broken(SplatsState::scene_3d(&state).map_err(&broken)?, values).map_err(&broken)?;
        let effects = &settings.effects;
        let frame = match metadata.get(FRAME_ENTRY) {
            Some(text) => WorldFrame::from_toml(text).map_err(|why| unusable(format!("its `{FRAME_ENTRY}`: {why}")))?,
            None => WorldFrame::WORLD,
        };
        let file = File3d {
            bytes: std::fs::metadata(path).map_or(0, |file| file.len()),
            trained_with: TrainedWith { antialias: Some(effects.antialias), order: Some(effects.order), frame },
            settings: Some(settings),
            ..File3d::of(Format3d::Checkpoint, scene)
        };
        (AnyScene::ThreeD(Box::new(file)), left_out)
    } else {
        let (width, height) =
            size_of_target(entry("target")?).ok_or_else(|| unusable("its `target` has no size".to_owned()))?;
        let (scene, left_out) =
            without_broken(SplatsState::scene_2d(&state).map_err(&broken)?, values).map_err(&broken)?;
        (AnyScene::TwoD(Box::new(File2d { scene, width, height, settings, profile: None })), left_out)
    };
    Ok(SceneFile { path: path.to_owned(), scene, metadata: Some(metadata), left_out, has_alpha: false })
}

/// The size in a fit's `target`, which begins with "64x48 px".
fn size_of_target(text: &str) -> Option<(u32, u32)> {
    let (width, height) = text.split_once(" px")?.0.split_once('x')?;
    Some((width.parse().ok()?, height.parse().ok()?))
}

/// The scene without Gaussians that cannot be drawn, unless they are allowed, and how many were
/// removed.
fn without_broken<S: Examinable>(mut scene: S, values: Values) -> Result<(S, usize), gs_core::Error> {
    let removed = match values {
        Values::Checked => examination::repair(&mut scene)?.removed,
        Values::Any => 0,
    };
    Ok((scene, removed))
}

impl File3d {
    /// The settings to render the scene with: those of its checkpoint, or else those that its file
    /// names, completed by what 3DGS uses.
    ///
    /// The background is black unless the scene is rendered beside a data set with another
    /// ([`DatasetKind::background`](crate::dataset::DatasetKind::background)).
    pub fn render_settings(&self, dataset: Option<&Dataset>) -> RenderSettings {
        self.settings.unwrap_or_else(|| {
            let background = dataset.map_or([0.0; 3], |dataset| dataset.kind.background());
            self.trained_with.render_settings(self.scene.sh_degree, background)
        })
    }
}

#[cfg(test)]
mod tests {
    use gs_core::{Parameterization, Tensor, TensorData, effects::Antialias};

    use super::*;
    use crate::checkpoint::write_checkpoint;

    fn checkpoint(settings: &str, target: &str) -> Checkpoint {
        let mut state = SplatsState::new(Parameterization::ScaleRotation);
        let columns = [("mean", 2), ("log_scale", 2), ("rotation", 1), ("color", 3)];
        for (name, columns) in columns {
            let shape = if columns == 1 { vec![2] } else { vec![2, columns] };
            let mut values = vec![0.5; 2 * columns];
            values[0] = if name == "mean" { f32::NAN } else { 0.5 };
            state.tensors.insert(name.to_owned(), Tensor { shape, data: TensorData::F32(values) });
        }
        let metadata =
            [("settings", settings), ("target", target)].map(|(key, value)| (key.to_owned(), value.to_owned()));
        Checkpoint { state, metadata: metadata.into() }
    }

    #[test]
    fn a_checkpoint_is_read_with_its_render_settings() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("checkpoint.safetensors");
        let settings = "iterations = 3\n[render]\nbackground = [0.5, 0.25, 0.0]\n[render.effects]\nantialias = 'mip'\n";
        write_checkpoint(&path, &checkpoint(settings, "64x48 px, 0123")).unwrap();
        for place in [folder.path(), &path] {
            assert!(is_scene(place).unwrap());
            let read = read_scene(place, Values::Checked).unwrap();
            assert_eq!((&read.path, read.left_out, read.metadata.unwrap().len()), (&path, 1, 2));
            let AnyScene::TwoD(file) = read.scene else { panic!("a 3D scene") };
            assert_eq!((file.width, file.height, file.scene.means.len()), (64, 48, 1));
            assert_eq!((file.settings.background, file.settings.effects.antialias), ([0.5, 0.25, 0.0], Antialias::Mip));
        }
        let AnyScene::TwoD(file) = read_scene(&path, Values::Any).unwrap().scene else { panic!("a 3D scene") };
        assert_eq!(file.scene.means.len(), 2);
    }

    #[test]
    fn a_checkpoint_without_render_settings_or_size_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("state");
        for (settings, target, expected) in [
            ("= 3", "64x48 px, 0123", "state: the checkpoint cannot be used: its `settings`: "),
            ("[render.effects]\norder = 'random'", "64x48 px, 0123", "its `settings`: "),
            ("", "3 views and 1 held out", "its `target` has no size"),
        ] {
            write_checkpoint(&path, &checkpoint(settings, target)).unwrap();
            let message = read_scene(&path, Values::Checked).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
        let message = read_scene(folder.path(), Values::Checked).unwrap_err().to_string();
        assert!(message.contains("holds no scene: looked for scene.gs2d.safetensors, scene.ply"), "{message}");
    }

    #[test]
    fn a_folder_of_a_scene_of_many_files_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let text = r#"{"asset": {}, "geometricError": 3, "root": {}}"#;
        std::fs::write(folder.path().join("tileset.json"), text).unwrap();
        let error = read_scene(folder.path(), Values::Checked).unwrap_err();
        let expected = "a tileset of 3D Tiles";
        assert!(matches!(error, Error::Unusable { .. }) && error.to_string().contains(expected), "{error}");
        assert_eq!(scene_in(folder.path()), None);
        std::fs::write(folder.path().join("scene.ply"), "").unwrap();
        assert_eq!(readable_in(folder.path()), Some(folder.path().join("scene.ply")));
    }
}
