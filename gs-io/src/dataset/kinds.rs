//! The files by which a folder is recognised as a data set, and their readers.

use std::path::{Path, PathBuf};

use super::{
    Dataset, DatasetSettings, llff, opensfm,
    transforms::{BLENDER_TRAIN, NERFSTUDIO, read_blender, read_nerfstudio},
};
use crate::error::Error;

/// Reads the data set in a folder, by one of its files.
pub(super) type Reader = fn(&Path, &Path, &DatasetSettings) -> Result<Dataset, Error>;

/// What is looked for in a folder, in words.
pub(super) const LOOKED_FOR: &str = "transforms_train.json (Blender), transforms.json (Nerfstudio), cameras.bin or cameras.txt in sparse, \
                                     colmap/sparse, dense/sparse, undistorted/sparse, distorted/sparse, their subfolders and the folder itself \
                                     (COLMAP), reconstruction.json, also in opensfm (OpenSfM, ODM), and poses_bounds.npy (LLFF)";

/// A `transforms.json`, or the first of Blender's, before which COLMAP's models do not count.
pub(super) fn transforms_in(folder: &Path) -> Option<(PathBuf, Reader)> {
    let blender = || named(folder, BLENDER_TRAIN, |root, _, settings| read_blender(root, settings));
    blender().or_else(|| named(folder, NERFSTUDIO, read_nerfstudio))
}

/// The file of another program than COLMAP, Nerfstudio and Blender.
pub(super) fn other_in(folder: &Path) -> Option<(PathBuf, Reader)> {
    let opensfm = |folder: &Path| named(folder, opensfm::RECONSTRUCTION, opensfm::read);
    opensfm(folder)
        .or_else(|| opensfm(&folder.join(opensfm::FOLDER)))
        .or_else(|| named(folder, llff::POSES, llff::read))
}

/// Whether a folder has a file of a data set, apart from COLMAP's.
pub(super) fn has_file(folder: &Path) -> bool {
    transforms_in(folder).or_else(|| other_in(folder)).is_some()
}

/// The reader of a file that is named itself, by its name. The JSON files of scenes have none:
/// `meta.json` and `lod-meta.json` of SOG, and `tileset.json` of 3D Tiles.
pub(super) fn reader_of(file: &Path) -> Option<Reader> {
    let name = file.file_name()?.to_string_lossy().to_lowercase();
    let extension = Path::new(&name).extension()?.to_str()?;
    match (&*name, extension) {
        ("meta.json" | "lod-meta.json" | "tileset.json", _) => None,
        (opensfm::RECONSTRUCTION, _) => Some(opensfm::read),
        (_, "json") => Some(read_nerfstudio),
        (llff::POSES, _) => Some(llff::read),
        _ => None,
    }
}

fn named(folder: &Path, name: &str, reader: Reader) -> Option<(PathBuf, Reader)> {
    let file = folder.join(name);
    file.is_file().then_some((file, reader))
}
