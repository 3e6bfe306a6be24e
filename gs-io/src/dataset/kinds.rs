//! The files by which a folder is recognised as a data set, and their readers.

use std::{
    fs::File,
    io::Read,
    path::{Path, PathBuf},
};

use super::{
    Dataset, DatasetSettings, llff, metashape, opensfm,
    read::entries,
    realityscan,
    transforms::{BLENDER_TRAIN, NERFSTUDIO, read_blender, read_nerfstudio},
};
use crate::error::Error;

/// Reads the data set in a folder, by one of its files.
pub(super) type Reader = fn(&Path, &Path, &DatasetSettings) -> Result<Dataset, Error>;

/// What is looked for in a folder, in words.
pub(super) const LOOKED_FOR: &str = "transforms_train.json (Blender), transforms.json (Nerfstudio), cameras.bin or cameras.txt in sparse, \
                                     colmap/sparse, dense/sparse, undistorted/sparse, distorted/sparse, their subfolders and the folder itself \
                                     (COLMAP), reconstruction.json, also in opensfm (OpenSfM, ODM), an XML file of cameras (Metashape), a CSV of \
                                     camera parameters (RealityScan), and \
                                     poses_bounds.npy (LLFF)";

/// Bytes at the beginning of a file by which it is recognised.
const BEGINNING: u64 = 1024;

/// A `transforms.json`, or the first of Blender's, before which COLMAP's models do not count.
pub(super) fn transforms_in(folder: &Path) -> Option<(PathBuf, Reader)> {
    let blender = || named(folder, BLENDER_TRAIN, |root, _, settings| read_blender(root, settings));
    blender().or_else(|| named(folder, NERFSTUDIO, read_nerfstudio))
}

/// The files of the first other program than COLMAP, Nerfstudio and Blender that has any.
pub(super) fn others_in(folder: &Path) -> Vec<(PathBuf, Reader)> {
    let opensfm = |folder: &Path| named(folder, opensfm::RECONSTRUCTION, opensfm::read);
    if let Some(found) = opensfm(folder).or_else(|| opensfm(&folder.join(opensfm::FOLDER))) {
        return vec![found];
    }
    let mut files: Vec<PathBuf> = entries(folder).map(|name| folder.join(name)).collect();
    files.sort();
    let exports = files.into_iter().filter_map(|file| Some((export(&file)?, file)));
    let exports: Vec<_> = exports.map(|(reader, file)| (file, reader)).collect();
    if exports.is_empty() { named(folder, llff::POSES, llff::read).into_iter().collect() } else { exports }
}

/// Whether a folder has a file of a data set, apart from COLMAP's.
pub(super) fn has_file(folder: &Path) -> bool {
    transforms_in(folder).is_some() || !others_in(folder).is_empty()
}

/// The reader of a file that is named itself. The JSON files of scenes have none: `meta.json` and
/// `lod-meta.json` of SOG, and `tileset.json` of 3D Tiles.
pub(super) fn reader_of(file: &Path) -> Option<Reader> {
    match &*file.file_name()?.to_string_lossy().to_lowercase() {
        "meta.json" | "lod-meta.json" | "tileset.json" => None,
        opensfm::RECONSTRUCTION => Some(opensfm::read),
        llff::POSES => Some(llff::read),
        name if name.ends_with(".json") => Some(read_nerfstudio),
        _ => export(file),
    }
}

fn named(folder: &Path, name: &str, reader: Reader) -> Option<(PathBuf, Reader)> {
    let file = folder.join(name);
    file.is_file().then_some((file, reader))
}

/// The reader of a file that people name as they like, by its extension and beginning.
fn export(file: &Path) -> Option<Reader> {
    let extension = file.extension()?.to_str()?.to_lowercase();
    let (begins, reader): (fn(&str) -> bool, Reader) = match &*extension {
        "xml" => (metashape::begins, metashape::read),
        "csv" => (realityscan::begins, realityscan::read),
        _ => return None,
    };
    let mut bytes = Vec::new();
    // Checked before opening, because opening a pipe without a writer waits forever.
    file.is_file().then(|| File::open(file).ok()?.take(BEGINNING).read_to_end(&mut bytes).ok())??;
    begins(&String::from_utf8_lossy(&bytes)).then_some(reader)
}
