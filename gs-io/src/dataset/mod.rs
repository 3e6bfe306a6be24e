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
//! undistorts an image when it is needed; a 360° image is six views, the faces of a cube.
//! [`Dataset::remarks`] says what was left out, and why.
//!
//! Poses and points are read in `f64`, and taken into the frame of [`Dataset::frame`] before they are
//! rounded. World axes are the data set's own.

mod camera;
mod colmap;
mod data_set;
mod how_to_begin;
mod images;
mod read;
mod remark;
mod settings;
mod split;
#[cfg(test)]
mod tests;
mod transforms;

use std::path::Path;

use self::camera::{AriaFisheye, BrownConrady, CubeFace, Distortion, Fisheye, Lens};
pub(crate) use self::colmap::{CameraModel, ColmapCamera, ColmapModel};
use self::how_to_begin::how_to_begin;
pub use self::{
    camera::SourceCamera,
    data_set::{Dataset, DatasetKind, Point},
    images::{CompactImage, DepthFile, DepthMap, PosedImage, View, read_images},
    remark::{Remark, Skip},
    settings::{AlphaMeaning, DatasetSettings},
    split::{Split, SplitOrigin},
};
use crate::error::Error;

/// The kind of file for messages about one that is something else.
const FILE: &str = "a file of a data set";

const LOOKED_FOR: &str = "transforms_train.json (Blender), transforms.json (Nerfstudio), and cameras.bin or cameras.txt in sparse, \
                          colmap/sparse, dense/sparse, undistorted/sparse, distorted/sparse, their subfolders and the folder itself (COLMAP)";

/// Whether a path can be a data set: a folder, or a JSON file. The JSON files of scenes cannot:
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
/// - [`Error::Missing`] where there is no such path.
/// - [`Error::NotADataset`] where it contains no data set.
/// - [`Error::Read`] and [`Error::Damaged`] where one of its files cannot be read.
/// - [`Error::Unusable`] where a file has content that is not supported, such as an unknown camera
///   model, and where the split leaves no view for training.
/// - [`Error::LeavesDataset`] where a file refers to a path outside of the folder.
/// - [`Error::NoViews`] where no view can be used.
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
    let (hint, photographs) = how_to_begin(path);
    Error::NotADataset { path: path.to_owned(), looked_for: LOOKED_FOR, hint, photographs }
}
