//! Finds the COLMAP model of a data set: where programs put it, and which one of several.

use std::{
    fs::{self, File},
    io::Read,
    path::{Component, Path, PathBuf},
};

use super::{super::place::Place, ColmapModel, NamePart};
use crate::{dataset::Remark, dataset::place::IMAGE_FOLDERS};

/// Folders of models, relative to the data set, in the order of preference. Each may be a model itself,
/// or have models in its subfolders, which COLMAP numbers. Undistorted models come before the
/// distorted one that they were made of.
const FOLDERS: [&str; 7] =
    ["sparse", "colmap/sparse", "dense/sparse", "dense/0/sparse", "sparse_txt", "text", "distorted/sparse"];

/// The folder of the photographs that a distorted model was made of, which are moved there by 3DGS's
/// convert.py.
const INPUT: &str = "input";

/// A model of a data set.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::dataset) struct Located {
    /// The folder of the model's files.
    pub(in crate::dataset) folder: PathBuf,
    /// The folder next to whose images the model is.
    home: PathBuf,
    /// What is worth knowing about other models.
    pub(in crate::dataset) remark: Option<Remark>,
}

impl Located {
    /// The model of a data set: the largest of the first folder that has any.
    pub(in crate::dataset) fn find(root: &Path) -> Option<Self> {
        let groups = FOLDERS.iter().map(|base| (root.join(base), models_in(&root.join(base))));
        let mut groups: Vec<(PathBuf, Vec<PathBuf>)> = groups.filter(|(_, models)| !models.is_empty()).collect();
        if is_model(root) {
            // Files in the named folder itself are meant, wherever else there are some.
            groups.insert(0, (root.join("model"), vec![root.to_owned()]));
        }
        let of_group = |(base, models): &(PathBuf, Vec<PathBuf>)| {
            let home = base.parent().unwrap_or(root).to_owned();
            let [only] = &models[..] else { return largest(root, home, models) };
            Located { folder: only.clone(), home, remark: None }
        };
        let mut located: Vec<Self> = groups.iter().map(of_group).collect();
        // A folder without a readable model is only taken to say what is wrong with it.
        let best = located.iter().position(|located| images(&located.folder) > 0).unwrap_or(0);
        (!located.is_empty()).then(|| located.swap_remove(best))
    }

    /// The folder of the data set, if this model's own folder was named in its place: the parent of
    /// `sparse`.
    pub(in crate::dataset) fn data_set(named: &Path) -> PathBuf {
        let Ok(whole) = std::path::absolute(named) else { return named.to_owned() };
        let names: Vec<_> = whole.components().filter(|part| matches!(part, Component::Normal(_))).collect();
        let is = |name: &Component<'_>, wanted: &str| name.as_os_str() == wanted;
        let Some(sparse) = names.iter().rposition(|name| is(name, "sparse")).filter(|at| names.len() - at <= 2) else {
            return named.to_owned();
        };
        let above = sparse.checked_sub(1).map(|at| &names[at]);
        let up =
            names.len() - sparse + usize::from(above.is_some_and(|name| is(name, "colmap") || is(name, "distorted")));
        whole.ancestors().nth(up).map_or_else(|| named.to_owned(), Path::to_owned)
    }

    /// Where the images of the model may be, in the order of preference.
    pub(in crate::dataset) fn places(&self, root: &Path) -> Vec<Place> {
        let distorted = self.home.file_name().is_some_and(|name| name == "distorted");
        let mut names: Vec<&str> = IMAGE_FOLDERS.to_vec();
        names.insert(if distorted { 0 } else { names.len() }, INPUT);
        let mut folders = vec![self.home.clone()];
        let of_data_set = Self::data_set(&self.folder);
        for folder in [root.to_owned(), of_data_set] {
            if !folders.contains(&folder) {
                folders.push(folder);
            }
        }
        let of_folder = |folder: &PathBuf| {
            // COLMAP can work inside the folder of the images itself.
            let own = Place { folder: folder.clone(), part: NamePart::Path, shrunk: 1.0 };
            names.iter().map(|name| Place::new(folder, name, NamePart::Path)).chain([own]).collect::<Vec<_>>()
        };
        folders.iter().flat_map(of_folder).collect()
    }
}

/// Whether a folder has the files of a model.
pub(in crate::dataset) fn is_model(folder: &Path) -> bool {
    ["cameras.bin", "cameras.txt"].iter().any(|name| folder.join(name).is_file())
}

/// All folders of a data set that hold a model, and those that they stand in.
pub(in crate::dataset) fn model_folders(root: &Path) -> impl Iterator<Item = PathBuf> {
    FOLDERS.into_iter().flat_map(|base| {
        let base = root.join(base);
        let models = models_in(&base);
        std::iter::once(base).chain(models)
    })
}

/// The models in a folder, itself or its subfolders, by name.
fn models_in(base: &Path) -> Vec<PathBuf> {
    let mut models: Vec<PathBuf> =
        fs::read_dir(base).into_iter().flatten().flatten().map(|entry| entry.path()).collect();
    models.push(base.to_owned());
    models.retain(|folder| is_model(folder));
    models.sort();
    models
}

/// The model with most images; of equal ones the first.
fn largest(root: &Path, home: PathBuf, models: &[PathBuf]) -> Located {
    let sizes: Vec<usize> = models.iter().map(|model| images(model)).collect();
    let most = sizes.iter().max().copied().unwrap_or(0);
    let best = sizes.iter().position(|size| *size == most).unwrap_or(0);
    let named = |index: usize| {
        let name = models[index].strip_prefix(root).unwrap_or(&models[index]);
        format!("{} ({} images)", name.display(), sizes[index])
    };
    let others = (0..models.len()).filter(|index| *index != best).map(named).collect();
    let remark = Some(Remark::OtherModels { read: named(best), others });
    Located { folder: models[best].clone(), home, remark }
}

/// Number of images in a model; 0 for one that cannot be read.
fn images(folder: &Path) -> usize {
    // The number in the file's header, without reading all keypoints.
    let mut start = [0; 8];
    let is_cut = fs::metadata(folder.join("cameras.bin")).is_ok_and(|file| file.len() < 8);
    let header = File::open(folder.join("images.bin")).and_then(|mut file| file.read_exact(&mut start));
    if header.is_ok() && !is_cut {
        let bytes = fs::metadata(folder.join("images.bin")).map_or(0, |file| file.len());
        // A record has 73 bytes at least.
        return usize::try_from(u64::from_le_bytes(start).min(bytes / 73)).unwrap_or(0);
    }
    ColmapModel::read(folder).map_or(0, |model| model.images.len())
}

/// The models below a folder, to a depth of four folders, for messages.
pub(in crate::dataset) fn models_below(root: &Path) -> Vec<PathBuf> {
    /// Most folders that are looked at.
    const MOST: usize = 2000;
    let (mut found, mut seen) = (Vec::new(), 0);
    let mut level = vec![root.to_owned()];
    for _ in 0..=4 {
        let mut next = Vec::new();
        for folder in level {
            seen += 1;
            if seen > MOST {
                return found;
            }
            if is_model(&folder) {
                found.push(folder.clone());
            }
            let entries = fs::read_dir(&folder).into_iter().flatten().flatten();
            next.extend(
                entries.filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_dir())).map(|entry| entry.path()),
            );
        }
        next.sort();
        level = next;
    }
    found
}
