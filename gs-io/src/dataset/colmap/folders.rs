//! Where programs put the COLMAP models of a data set.

use std::path::{Path, PathBuf};

use crate::{
    dataset::read::{IMAGE_FOLDERS, entries, whole},
    image::image_files,
};

/// Folders of models, relative to the data set, in the order of preference. Each may be a model itself,
/// or have models in its subfolders, which COLMAP numbers.
const FOLDERS: [&str; 12] = [
    "",
    "sparse",
    "colmap/sparse",
    "colmap",
    "dense/sparse",
    "dense/0/sparse",
    "dense",
    "undistorted/sparse",
    "undistorted",
    "sparse_txt",
    "text",
    "distorted/sparse",
];

/// Names of folders that are part of a data set.
const INNER: [&str; 7] = ["sparse", "colmap", "dense", "undistorted", "sparse_txt", "text", "distorted"];

/// The folder of the photographs that a distorted model was made of, which are moved there by 3DGS's
/// convert.py.
pub(super) const INPUT: &str = "input";

/// Whether a folder has the files of a model.
pub(crate) fn is_model(folder: &Path) -> bool {
    ["cameras.bin", "cameras.txt"].iter().any(|name| folder.join(name).is_file())
}

/// The folders of the models of a data set.
pub(crate) fn models_of(root: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for base in FOLDERS {
        let base = if base.is_empty() { root.to_owned() } else { root.join(base) };
        let mut inner: Vec<PathBuf> = entries(&base).map(|name| base.join(name)).collect();
        // Other folders in that of the data set are data sets of their own.
        inner.retain(|folder| base != root || is_number(folder));
        inner.sort();
        inner.insert(0, base);
        inner.retain(|folder| is_model(folder) && !found.contains(folder));
        found.append(&mut inner);
    }
    found
}

pub(super) fn is_named(folder: &Path, matches: impl Fn(&str) -> bool) -> bool {
    folder.file_name().and_then(|name| name.to_str()).is_some_and(matches)
}

fn is_number(folder: &Path) -> bool {
    is_named(folder, |name| name.bytes().all(|byte| byte.is_ascii_digit()))
}

/// Whether photographs of a data set are in this folder, or where they usually are in it.
pub(crate) fn has_photographs(folder: &Path) -> bool {
    IMAGE_FOLDERS.iter().chain([&INPUT]).any(|name| folder.join(name).is_dir())
        || image_files(folder).is_ok_and(|files| !files.is_empty())
}

/// The folder of the data set that a model or the folder of models is part of: the nearest one with
/// photographs.
pub(crate) fn data_set_of(named: &Path) -> PathBuf {
    let whole = whole(named);
    let is_inner = |folder: &Path| is_named(folder, |name| INNER.contains(&name));
    let mut folder = whole.as_path();
    while let Some(above) = folder.parent().filter(|_| !has_photographs(folder)) {
        if !(is_inner(folder) || is_number(folder) && (is_inner(above) || has_photographs(above))) {
            break;
        }
        folder = above;
    }
    if folder == whole { named.to_owned() } else { folder.to_owned() }
}
