//! Posed photographs: what a 3D scene is trained from, read from the data sets that the field's tools write.
//!
//! | kind | made by | what is looked for |
//! |---|---|---|
//! | [`Blender`](DatasetKind::Blender) | NeRF-synthetic and its like | `transforms_train.json`, with `_val` and `_test` beside it |
//! | [`Nerfstudio`](DatasetKind::Nerfstudio) | Nerfstudio, instant-ngp, Polycam | `transforms.json` |
//! | [`Colmap`](DatasetKind::Colmap) | COLMAP and what writes its files | `cameras`, `images`, `points3D`, `.bin` or `.txt`, in `sparse/0`, `sparse`, `colmap/sparse/0` or the folder itself |
//!
//! [`read_dataset`] finds out which and reads all but the pixels: of the photographs only the headers, so that the intrinsics are those
//! of the files that are there. [`View::read_image`] reads a photograph when it is needed, undistorted. What was left out, and why, is
//! counted in [`Dataset::remarks`]; a data set without a usable view is an error.
//!
//! World axes and unit are the data set's own.

mod assemble;
mod colmap;
mod distortion;
mod lens;
mod photograph;
mod place;
mod point_cloud;
mod pose;
mod remark;
mod resample;
mod shrink;
mod source_camera;
mod tally;
mod transforms;

use std::{
    io::Read,
    num::NonZeroU32,
    path::{Path, PathBuf},
};

use glam::Vec3;
use gs_core::Camera;
use serde::{Deserialize, Serialize};

pub use self::{
    colmap::{CameraModel, ColmapCamera, ColmapImage, ColmapModel, ColmapPoint, Observation},
    distortion::{AriaFisheye, BrownConrady, Distortion, Fisheye},
    lens::Lens,
    photograph::PosedImage,
    remark::{Remark, Skip},
    source_camera::SourceCamera,
};
use crate::{atomic::open, error::Error, image::Orientation};

/// Where COLMAP models are looked for, relative to the data set.
const COLMAP_FOLDERS: [&str; 5] = ["sparse/0", "sparse", "colmap/sparse/0", "colmap/sparse", "."];

const LOOKED_FOR: &str = "transforms_train.json (Blender), transforms.json (Nerfstudio), and cameras.bin or cameras.txt in sparse/0, \
                          sparse, colmap/sparse/0, colmap/sparse and the folder itself (COLMAP)";

/// What to read of a data set, and how.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct DatasetSettings {
    /// The folder inside the data set that the photographs are taken from, such as `images_4`. `None`: where the data set says; else the
    /// first of `images`, `images_2`, `images_4` and `images_8` in which there is one. Intrinsics follow the real size.
    pub image_folder: Option<String>,
    /// Where the data set says nothing about it, every n-th view by name, the first included, is held out for tests; `None` holds out
    /// none. *Source:* Mip-NeRF 360 and 3DGS hold out every 8th.
    pub test_every: Option<NonZeroU32>,
    /// What alpha channels of photographs mean.
    pub alpha: AlphaMeaning,
    /// Photographs whose longer side has more pixels than this are scaled down to it when they are read, and intrinsics with them. `None`
    /// leaves them as they are.
    pub max_side: Option<NonZeroU32>,
    /// Whether files outside the data set's folder are read where the data set names them: by absolute paths, or through `..`. Without it
    /// such a data set is refused. Links inside the folder are followed in either case.
    pub allow_outside: bool,
}

impl Default for DatasetSettings {
    fn default() -> Self {
        Self {
            image_folder: None,
            test_every: NonZeroU32::new(8),
            alpha: AlphaMeaning::Opacity,
            max_side: None,
            allow_outside: false,
        }
    }
}

/// What the alpha channel of a photograph means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AlphaMeaning {
    /// How opaque the object is there: the scene shall be as transparent (NeRF-synthetic).
    #[default]
    Opacity,
    /// Whether the pixel counts: from ½ on it does.
    Mask,
}

/// Who made a data set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum DatasetKind {
    /// COLMAP's sparse model.
    Colmap,
    /// A `transforms.json`.
    Nerfstudio,
    /// `transforms_train.json` and its companions.
    Blender,
}

impl DatasetKind {
    /// As its users write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Colmap => "COLMAP",
            Self::Nerfstudio => "Nerfstudio",
            Self::Blender => "Blender",
        }
    }
}

/// What a view is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Split {
    /// To train with.
    Train,
    /// To choose settings by; Blender's `transforms_val.json`.
    Validation,
    /// To be judged by, never trained with.
    Test,
}

/// Posed photographs, and the points that were triangulated from them.
#[derive(Debug, Clone, PartialEq)]
pub struct Dataset {
    /// Who made it.
    pub kind: DatasetKind,
    /// Its folder.
    pub root: PathBuf,
    /// The views that can be used, sorted by name, each name once; never empty, and never without one to train with.
    pub views: Vec<View>,
    /// Points of the scene; often none (Blender).
    pub points: Vec<Point>,
    /// What is worth knowing: what was left out, scaled, undistorted.
    pub remarks: Vec<Remark>,
}

impl Dataset {
    /// The views of one split, by name.
    pub fn views_of(&self, split: Split) -> impl Iterator<Item = &View> {
        self.views.iter().filter(move |view| view.split == split)
    }

    /// The files that belong to it: the images and masks of its views, and what lies beside them in its folder and in COLMAP's `sparse`,
    /// such as poses and points. A program that reads the data set must not write to them.
    pub fn files(&self) -> Vec<PathBuf> {
        let of_views = self.views.iter().flat_map(|view| [Some(view.image.clone()), view.mask.clone()]).flatten();
        let root = if self.root.as_os_str().is_empty() { Path::new(".") } else { &self.root };
        let folders = ["", "sparse", "sparse/0", "colmap/sparse/0"].map(|name| root.join(name));
        let entries = folders.into_iter().flat_map(|folder| std::fs::read_dir(folder).into_iter().flatten().flatten());
        of_views.chain(entries.map(|entry| entry.path()).filter(|path| path.is_file())).collect()
    }
}

/// A photograph, where it was taken from, and with which camera.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// As the data set calls it: the path below its image folder, with extension where it has one.
    pub name: String,
    /// The pinhole camera of what [`Self::read_image`] gives: pose, and intrinsics at that size.
    pub camera: Camera,
    /// The same at the full size of the photograph, from which it may be scaled down ([`DatasetSettings::max_side`]).
    pub full: Camera,
    /// The camera that took the photograph: size and intrinsics of the file, and its lens.
    pub source: SourceCamera,
    /// The file of the photograph.
    pub image: PathBuf,
    /// Which way up the file is taken: cameras are calibrated on pixels as they are stored, unless only the turned picture fits.
    pub orientation: Orientation,
    /// An image of the photograph's shape, at any size; what is darker than mid-grey does not count.
    pub mask: Option<PathBuf>,
    /// What the photograph's alpha channel means, where it has one.
    pub alpha: AlphaMeaning,
    /// What the view is for.
    pub split: Split,
}

/// A point of the scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// World units; finite.
    pub position: Vec3,
    /// RGB as in the photographs, 0 to 1.
    pub color: [f32; 3],
}

/// Whether a path names a data set rather than a file of another kind: a folder, or a JSON file.
pub fn may_be_dataset(path: &Path) -> bool {
    path.is_dir() || path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"))
}

/// Reads a data set: a folder, of which the content tells the kind, or a `transforms.json`.
///
/// # Errors
/// [`Error::Missing`], [`Error::NotADataset`], [`Error::NoViews`], [`Error::LeavesDataset`]; for its files [`Error::Read`], [`Error::Damaged`],
/// [`Error::DamagedLine`], [`Error::DamagedJson`], [`Error::UnknownCameraModel`], [`Error::NotAPointCloud`].
pub fn read_dataset(path: impl AsRef<Path>, settings: &DatasetSettings) -> Result<Dataset, Error> {
    let path = path.as_ref();
    let metadata = std::fs::metadata(path).map_err(|source| Error::read(path, source))?;
    if !metadata.is_dir() {
        if !may_be_dataset(path) {
            return Err(not_a_dataset(path));
        }
        let root = path.parent().unwrap_or(Path::new(""));
        return transforms::read_nerfstudio(root, path, settings);
    }
    if path.join(transforms::BLENDER_TRAIN).is_file() {
        return transforms::read_blender(path, settings);
    }
    let nerfstudio = path.join(transforms::NERFSTUDIO);
    if nerfstudio.is_file() {
        return transforms::read_nerfstudio(path, &nerfstudio, settings);
    }
    match colmap_folder(path) {
        Some(folder) => colmap::read(path, &folder, settings),
        None => Err(not_a_dataset(path)),
    }
}

fn not_a_dataset(path: &Path) -> Error {
    Error::NotADataset { path: path.to_owned(), looked_for: LOOKED_FOR, mend: place::how_to_begin(path) }
}

/// The folder of a data set that holds a COLMAP model.
fn colmap_folder(root: &Path) -> Option<PathBuf> {
    let holds_model = |folder: &PathBuf| ["cameras.bin", "cameras.txt"].iter().any(|name| folder.join(name).is_file());
    COLMAP_FOLDERS
        .iter()
        .map(|folder| if *folder == "." { root.to_owned() } else { root.join(folder) })
        .find(holds_model)
}

/// All bytes of one of a data set's files.
fn read_file(path: &Path) -> Result<Vec<u8>, Error> {
    let mut bytes = Vec::new();
    let read = open(path, "a file of a data set")?.0.read_to_end(&mut bytes);
    read.map(|_| bytes).map_err(|source| Error::read(path, source))
}
