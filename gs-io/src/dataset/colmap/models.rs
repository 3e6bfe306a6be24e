//! Finds the COLMAP model of a data set: where programs put it, and which one of several.

use std::{
    collections::BTreeSet,
    path::{MAIN_SEPARATOR, Path, PathBuf},
};

use super::ColmapModel;
use crate::{
    dataset::{
        DatasetSettings, Remark,
        read::{Draft, Finder, IMAGE_FOLDERS, NamePart, Place, check_inside, entries, search_folders, whole},
    },
    error::Error,
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
const INPUT: &str = "input";

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

fn is_named(folder: &Path, matches: impl Fn(&str) -> bool) -> bool {
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

/// Where the images of a model may be, in the order of preference.
fn places(root: &Path, model: &Path, settings: &DatasetSettings) -> Result<Vec<Place>, Error> {
    // Where the model was named, the folder of images may be relative to it.
    let is_of_root = settings.image_folder.as_ref().is_none_or(|name| root.join(name).is_dir());
    if let Some(place) = Place::chosen(if is_of_root { root } else { model }, settings, NamePart::Path)? {
        return Ok(vec![place]);
    }
    let distorted = model.ancestors().take(3).any(|folder| is_named(folder, |name| name == "distorted"));
    let mut names: Vec<&str> = IMAGE_FOLDERS.to_vec();
    names.insert(if distorted { 0 } else { names.len() }, INPUT);
    let of_folder = |folder: PathBuf| {
        // COLMAP can work inside the folder of the images itself.
        let own = Place { folder: folder.clone(), part: NamePart::Path, shrunk: 1.0 };
        names.iter().map(|name| Place::new(&folder, name, NamePart::Path)).chain([own]).collect::<Vec<_>>()
    };
    Ok([data_set_of(model), root.to_owned()].into_iter().flat_map(of_folder).collect())
}

/// A model that has been read.
pub(super) struct Candidate {
    pub(super) folder: PathBuf,
    pub(super) model: ColmapModel,
    pub(super) drafts: Vec<Draft>,
    pub(super) places: Vec<Place>,
    /// What was wrong with the model's other files.
    pub(super) damaged: Option<Remark>,
}

impl Candidate {
    fn read(root: &Path, folder: &Path, settings: &DatasetSettings) -> Result<Self, Error> {
        let (model, extension, damaged) = ColmapModel::read_either(folder)?;
        let names = model.images.iter().map(|image| ("the image name", image.name.as_str()));
        check_inside(root, &folder.join("images").with_extension(extension), names, settings)?;
        let cameras = format!("cameras.{extension}");
        let drafts = model.images.iter().map(|image| model.draft(root, &cameras, image)).collect();
        Ok(Self { folder: folder.to_owned(), model, drafts, places: places(root, folder, settings)?, damaged })
    }

    /// Number of its images whose files are there.
    fn photographs(&self, root: &Path, settings: &DatasetSettings) -> usize {
        let mut finder = Finder::new(root, &self.places, &self.drafts, &search_folders(root, settings));
        self.drafts.iter().filter(|draft| draft.file.as_ref().is_some_and(|file| finder.find(file).is_some())).count()
    }

    fn is_undistorted(&self) -> bool {
        self.model.cameras.values().all(|camera| camera.model.name().ends_with("PINHOLE"))
    }

    fn names(&self) -> BTreeSet<&str> {
        self.drafts.iter().map(|draft| &*draft.name).collect()
    }
}

/// Reads the model with most photographs, then images; of equal ones an undistorted one, or the first.
pub(super) fn read_largest(
    root: &Path,
    folders: &[PathBuf],
    settings: &DatasetSettings,
) -> Result<(Candidate, Option<Remark>), Error> {
    if let [only] = folders {
        return Ok((Candidate::read(root, only, settings)?, None));
    }
    let mut read: Vec<_> = folders.iter().map(|folder| Candidate::read(root, folder, settings)).collect();
    let photographs: Vec<usize> =
        read.iter().map(|read| read.as_ref().map_or(0, |model| model.photographs(root, settings))).collect();
    let rank = |index: &usize| {
        read[*index].as_ref().ok().map(|model| (photographs[*index], model.drafts.len(), model.is_undistorted()))
    };
    // Of equal ones, `max_by_key` takes the last.
    let best = (0..read.len()).rev().max_by_key(rank).unwrap_or(0);
    let named = |index: usize| {
        let (folder, there) = (&folders[index], photographs[index]);
        let images = |count| gs_core::counted(count, "image");
        let size = match &read[index] {
            Ok(model) if there == model.drafts.len() => images(there),
            Ok(model) => format!("{}, {there} of them with a file", images(model.drafts.len())),
            Err(error) => error.to_string().replace(&format!("{}{MAIN_SEPARATOR}", folder.display()), ""),
        };
        format!("{} ({size})", folder.strip_prefix(root).unwrap_or(folder).display())
    };
    // A later model of the same images is a copy or the one that this was made of.
    let is_same = |index: usize| match (&read[index], &read[best]) {
        (Ok(other), Ok(model)) => index > best && other.names() == model.names(),
        _ => false,
    };
    let others: Vec<String> = (0..read.len()).filter(|&index| index != best && !is_same(index)).map(named).collect();
    let remark = (!others.is_empty()).then(|| Remark::OtherModels { read: named(best), others });
    Ok((read.swap_remove(best)?, remark))
}
