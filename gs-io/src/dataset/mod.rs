//! Data sets of posed images, from which 3D scenes are trained, as common tools write them.
//!
//! | kind | made by | what is looked for |
//! |---|---|---|
//! | [`Blender`](DatasetKind::Blender) | NeRF-synthetic and its like | `transforms_train.json`, with `_val` and `_test` next to it |
//! | [`Nerfstudio`](DatasetKind::Nerfstudio) | Nerfstudio, instant-ngp, Polycam | `transforms.json` |
//! | [`Colmap`](DatasetKind::Colmap) | COLMAP and what writes its files | `cameras`, `images`, `points3D`, `.bin` or `.txt`, in `sparse`, `colmap/sparse`, `dense/sparse`, `undistorted/sparse`, `distorted/sparse`, a subfolder of these, or the folder itself |
//!
//! [`read_dataset`] recognises the kind and reads everything but the pixels. Of the images it reads
//! the headers, so that intrinsics fit the files that exist. [`View::read_image`] reads and
//! undistorts an image when it is needed; a 360° image is six views, the faces of a cube. [`Dataset::remarks`] says what was left out, and why.
//!
//! Poses and points are read in `f64`, and taken into the frame of [`Dataset::frame`] before they are
//! rounded. World axes are the data set's own.

mod camera;
mod colmap;
mod images;
mod read;
mod remark;
mod split;
mod transforms;

use std::{
    io::Read,
    num::NonZeroU32,
    path::{Path, PathBuf},
};

use glam::{DVec3, Vec3};
use gs_core::Camera;
use serde::Serialize;

pub use self::{
    camera::{AriaFisheye, BrownConrady, CubeFace, Distortion, Fisheye, Lens, SourceCamera},
    colmap::{CameraModel, ColmapCamera, ColmapImage, ColmapModel, ColmapObservation, ColmapPoint},
    images::{DepthFile, DepthMap, PosedImage, read_images},
    remark::{Remark, Skip},
    split::{Split, SplitOrigin},
};
use crate::{WorldFrame, atomic::open, error::Error, image::Orientation};

const LOOKED_FOR: &str = "transforms_train.json (Blender), transforms.json (Nerfstudio), and cameras.bin or cameras.txt in sparse, \
                          colmap/sparse, dense/sparse, undistorted/sparse, distorted/sparse, their subfolders and the folder itself (COLMAP)";

/// Settings for reading a data set.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct DatasetSettings {
    /// The folder with the images, relative to the data set, such as `images_4`. `None` uses the
    /// data set's own, or the first of `images`, `images_2`, `images_4` and `images_8` that has
    /// images. Intrinsics follow the real size.
    pub image_folder: Option<String>,
    /// If the data set has no split, every n-th view by name, starting with the first, is held out
    /// for tests; `None` holds out none. *Source:* Mip-NeRF 360 and 3DGS hold out every 8th.
    pub test_every: Option<NonZeroU32>,
    /// Whether [`Self::test_every`] replaces the data set's own split.
    pub replace_split: bool,
    /// The meaning of the images' alpha channels.
    pub alpha: AlphaMeaning,
    /// Images with a longer side are scaled down to this many pixels when they are read, with their
    /// intrinsics. `None` never scales.
    pub max_side: Option<NonZeroU32>,
    /// The frame of cameras and points, such as that of a scene to render from these views. `None`
    /// chooses one that suits the data set ([`WorldFrame::of`]).
    pub frame: Option<WorldFrame>,
    /// Whether files outside the data set's folder may be read, if the data set refers to them by
    /// absolute paths or `..`. Otherwise such a data set is refused. Links inside the folder are
    /// always followed.
    pub allow_outside: bool,
}

gs_core::impl_with!(DatasetSettings);

impl Default for DatasetSettings {
    fn default() -> Self {
        Self {
            image_folder: None,
            test_every: NonZeroU32::new(8),
            replace_split: false,
            alpha: AlphaMeaning::Opacity,
            max_side: None,
            frame: None,
            allow_outside: false,
        }
    }
}

/// The meaning of an image's alpha channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum AlphaMeaning {
    /// Opacity of the object: the scene should be as transparent (NeRF-synthetic).
    #[default]
    Opacity,
    /// A mask: pixels count from ½ on.
    Mask,
}

/// The kind of a data set.
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
    /// The name for messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Colmap => "COLMAP",
            Self::Nerfstudio => "Nerfstudio",
            Self::Blender => "Blender",
        }
    }

    /// The usual background: white for Blender's objects without surroundings, otherwise black.
    pub fn background(self) -> [f32; 3] {
        if self == Self::Blender { [1.0; 3] } else { [0.0; 3] }
    }
}

/// A data set of posed images, with the points that were triangulated from them.
#[derive(Debug, Clone, PartialEq)]
pub struct Dataset {
    /// The kind.
    pub kind: DatasetKind,
    /// The folder.
    pub root: PathBuf,
    /// The frame of all cameras and points, relative to the data set's own world.
    pub frame: WorldFrame,
    /// The usable views, sorted by unique names; never empty, and at least one is for training.
    pub views: Vec<View>,
    /// Points of the scene; often none (Blender).
    pub points: Vec<Point>,
    /// Where the split comes from.
    pub split: SplitOrigin,
    /// Remarks on what was left out, scaled or undistorted.
    pub remarks: Vec<Remark>,
}

impl Dataset {
    /// The views of a split, sorted by name.
    pub fn views_of(&self, split: Split) -> impl Iterator<Item = &View> {
        self.views.iter().filter(move |view| view.split == split)
    }

    /// All files of the data set, which a program that reads it must not replace: images, masks,
    /// depth maps, and everything else in its folder and in COLMAP's `sparse`, such as poses and points.
    pub fn files(&self) -> Vec<PathBuf> {
        let depth = |view: &View| view.depth.as_ref().map(|depth| depth.path.clone());
        let files = |view: &View| [Some(view.image.clone()), view.mask.clone(), depth(view)];
        let of_views = self.views.iter().flat_map(files).flatten();
        let root = if self.root.as_os_str().is_empty() { Path::new(".") } else { &self.root };
        let models = colmap::models_of(root);
        let above = models.iter().filter_map(|model| model.parent());
        let folders: Vec<&Path> =
            std::iter::once(root).chain(above).chain(models.iter().map(|model| &**model)).collect();
        let entries = folders.into_iter().flat_map(|folder| std::fs::read_dir(folder).into_iter().flatten().flatten());
        of_views.chain(entries.map(|entry| entry.path()).filter(|path| path.is_file())).collect()
    }
}

/// An image with its pose and camera.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// The name in the data set: the path below its image folder, with extension if it has one. A
    /// face of a 360° image or of a wide fish-eye adds its own: `image.jpg#front`.
    pub name: String,
    /// The pinhole camera of [`Self::read_image`]: pose, and intrinsics at that size.
    pub camera: Camera,
    /// The camera at the image's full size, before it is scaled down
    /// ([`DatasetSettings::max_side`]).
    pub full: Camera,
    /// The camera of the image file: its size, intrinsics and lens.
    pub source: SourceCamera,
    /// The image file.
    pub image: PathBuf,
    /// The orientation of the file. Cameras are calibrated on pixels as stored, unless only the
    /// rotated image fits.
    pub orientation: Orientation,
    /// The mask file: an image of the same shape, of any size, whose pixels darker than mid-grey do
    /// not count.
    pub mask: Option<PathBuf>,
    /// The depth map, if there is one.
    pub depth: Option<DepthFile>,
    /// The meaning of the image's alpha channel.
    pub alpha: AlphaMeaning,
    /// The purpose of the view.
    pub split: Split,
}

/// A point of the scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Position in the data set's frame; finite.
    pub position: Vec3,
    /// RGB as in the images, 0 to 1.
    pub color: [f32; 3],
}

/// A point as a file has it, in the data set's world.
#[derive(Debug, Clone, Copy, PartialEq)]
struct WorldPoint {
    position: DVec3,
    color: [f32; 3],
}

/// Whether a path may be that of a data set: a folder, or a JSON file other than those of scenes:
/// `meta.json` and `lod-meta.json` of SOG, and `tileset.json` of 3D Tiles.
pub fn may_be_dataset(path: &Path) -> bool {
    let is_json = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
    let is_of_scene = ["meta.json", "lod-meta.json", "tileset.json"]
        .iter()
        .any(|name| path.file_name().is_some_and(|found| found.eq_ignore_ascii_case(name)));
    path.is_dir() || is_json && !is_of_scene
}

/// Reads a data set: a folder, whose content determines the kind, or a `transforms.json`.
///
/// # Errors
/// [`Error::Missing`], [`Error::NotADataset`], [`Error::NoViews`], [`Error::LeavesDataset`]; for
/// its files [`Error::Read`], [`Error::Damaged`], [`Error::DamagedLine`], [`Error::DamagedJson`],
/// [`Error::NotUtf8`], [`Error::UnknownCameraModel`], [`Error::NotAPointCloud`], and
/// [`Error::UnsplitPanorama`]; for its split [`Error::NoTrainingViews`] and
/// [`Error::SplitMatchesNothing`].
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
    match colmap::models_of(path) {
        models if models.is_empty() => Err(not_a_dataset(path)),
        models => colmap::read(path, &models, settings),
    }
}

fn not_a_dataset(path: &Path) -> Error {
    Error::NotADataset { path: path.to_owned(), looked_for: LOOKED_FOR, mend: read::how_to_begin(path) }
}

/// Reads a file of a data set.
fn read_file(path: &Path) -> Result<Vec<u8>, Error> {
    let mut bytes = Vec::new();
    let read = open(path, "a file of a data set")?.0.read_to_end(&mut bytes);
    read.map(|_| bytes).map_err(|source| Error::read(path, source))
}
