//! Data sets of posed images, from which 3D scenes are trained, as common tools write them.
//!
//! | kind | made by | what is looked for |
//! |---|---|---|
//! | [`Blender`](DatasetKind::Blender) | NeRF-synthetic and its like | `transforms_train.json`, with `_val` and `_test` next to it |
//! | [`Nerfstudio`](DatasetKind::Nerfstudio) | Nerfstudio, instant-ngp, Polycam | `transforms.json` |
//! | [`Colmap`](DatasetKind::Colmap) | COLMAP and what writes its files | `cameras`, `images`, `points3D`, `.bin` or `.txt`, in `sparse`, `colmap/sparse`, `dense/sparse`, `undistorted/sparse`, `distorted/sparse`, a subfolder of these, or the folder itself |
//! | [`OpenSfm`](DatasetKind::OpenSfm) | OpenSfM, OpenDroneMap | `reconstruction.json`, also in `opensfm` |
//! | [`Metashape`](DatasetKind::Metashape) | Agisoft Metashape | an XML file with its cameras |
//! | [`RealityScan`](DatasetKind::RealityScan) | RealityScan, once RealityCapture | a CSV file with its cameras |
//! | [`Llff`](DatasetKind::Llff) | LLFF | `poses_bounds.npy` |
//!
//! Of several, the first in this table counts.
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
mod files;
mod how_to_begin;
mod images;
mod kinds;
mod llff;
mod metashape;
mod opensfm;
mod read;
mod realityscan;
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
use self::kinds::{LOOKED_FOR, others_in, reader_of, transforms_in};
use self::remark::FILE;
pub use self::{
    camera::SourceCamera,
    data_set::{Dataset, DatasetKind, Point},
    images::{CompactImage, DepthFile, DepthMap, PosedImage, View, Window, read_images},
    remark::{Remark, Skip},
    settings::{AlphaMeaning, DatasetSettings},
    split::{Split, SplitOrigin},
};
use crate::error::Error;

/// Whether a path can be a data set: a folder, or the file of one by its name, such as a JSON file
/// that is not of a scene.
pub fn may_be_dataset(path: &Path) -> bool {
    path.is_dir() || reader_of(path).is_some()
}

/// Reads a data set: a folder, whose content determines the kind, or its file, such as a `transforms.json`.
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
        let read = reader_of(path).ok_or_else(|| not_a_dataset(path))?;
        return read(path.parent().unwrap_or(Path::new("")), path, settings);
    }
    if let Some((file, read)) = transforms_in(path) {
        return read(path, &file, settings);
    }
    let models = colmap::models_of(path);
    if !models.is_empty() {
        return colmap::read(path, &models, settings);
    }
    match &others_in(path)[..] {
        [] => Err(not_a_dataset(path)),
        [(file, read)] => read(path, file, settings),
        several => {
            let names: Vec<_> =
                several.iter().filter_map(|(file, _)| Some(file.file_name()?.to_string_lossy())).collect();
            let problem = format!("it has several files of cameras: {}", names.join(", "));
            Err(Error::unusable(path, problem, "name one of them instead of the folder"))
        }
    }
}

fn not_a_dataset(path: &Path) -> Error {
    let (hint, photographs) = how_to_begin(path);
    Error::NotADataset { path: path.to_owned(), looked_for: LOOKED_FOR, hint, photographs }
}
