//! Finds images: the folders of a data set, and file names without extension or with another one.

use std::{
    collections::BTreeSet,
    fs, io,
    path::{Component, Path, PathBuf},
};

use super::{
    finder::walk,
    names::{self, EXTENSIONS},
};
use crate::{
    dataset::{
        DatasetSettings,
        colmap::{data_set_of, has_photographs, is_model, models_of},
        transforms::{BLENDER_TRAIN, NERFSTUDIO},
    },
    error::Error,
    image::{image_files, unreadable_photographs},
    text::quoted,
};

/// Folders that are searched for images if none is given, the largest images first.
pub(crate) const IMAGE_FOLDERS: [&str; 4] = ["images", "images_2", "images_4", "images_8"];

/// A folder that may contain images.
#[derive(Debug, Clone)]
pub(crate) struct Place {
    pub(crate) folder: PathBuf,
    pub(crate) part: NamePart,
    /// The factor by which its images are smaller than those of the data set.
    pub(crate) shrunk: f64,
}

/// The part of an image's name that is looked up in a folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum NamePart {
    /// The whole path.
    Path,
    /// The file name only.
    FileName,
}

impl Place {
    /// The folder that the settings name, if they do.
    pub(crate) fn chosen(root: &Path, settings: &DatasetSettings, part: NamePart) -> Result<Option<Self>, Error> {
        let Some(name) = &settings.image_folder else { return Ok(None) };
        let folder = root.join(name);
        fs::metadata(&folder).map_err(|source| Error::read(&folder, source))?;
        Ok(Some(Self::new(root, name, part)))
    }

    /// A folder whose name ends in `_4` contains images of a quarter of the size.
    pub(crate) fn new(root: &Path, name: &str, part: NamePart) -> Self {
        let folder = root.join(name);
        let last = folder.file_name().unwrap_or_default().to_string_lossy();
        let shrunk = last.rsplit_once('_').and_then(|(_, factor)| factor.parse::<u32>().ok()).filter(|f| *f > 0);
        Self { shrunk: shrunk.map_or(1.0, f64::from), folder, part }
    }

    /// The file of the image of this name.
    pub(crate) fn find(&self, file: &Path) -> Option<PathBuf> {
        find_image(&self.expected(file))
    }

    /// The path of the image of this name, whether it exists or not.
    pub(crate) fn expected(&self, file: &Path) -> PathBuf {
        match self.part {
            NamePart::Path => self.folder.join(file),
            NamePart::FileName => self.folder.join(file.file_name().unwrap_or_default()),
        }
    }
}

/// The image at a path, or one with the same name and another extension.
pub(crate) fn find_image(path: &Path) -> Option<PathBuf> {
    if path.is_file() {
        return Some(path.to_owned());
    }
    let appended = EXTENSIONS.iter().map(|extension| {
        let mut name = path.as_os_str().to_owned();
        name.push(".");
        name.push(extension);
        PathBuf::from(name)
    });
    let replaced = EXTENSIONS.iter().map(|extension| path.with_extension(extension));
    appended.chain(replaced).find(|path| path.is_file())
}

/// Fails where a data set refers to a file outside its folder `root`, unless the settings allow it.
/// `file` contains the references, with their keys.
pub(crate) fn check_inside<'n>(
    root: &Path,
    file: &Path,
    names: impl IntoIterator<Item = (&'static str, &'n str)>,
    settings: &DatasetSettings,
) -> Result<(), Error> {
    let mut leaving = names.into_iter().filter(|(_, name)| !settings.allow_outside && leaves(root, name));
    let Some((key, name)) = leaving.next() else { return Ok(()) };
    let more = leaving.count();
    Err(Error::LeavesDataset { path: file.to_owned(), key, name: name.to_owned(), more })
}

/// Whether a path, joined to a folder, leaves it. Links are not checked: whoever may put files into
/// the folder may put links there.
fn leaves(folder: &Path, name: &str) -> bool {
    let plain = names::plain(name);
    let path = Path::new(&plain);
    let up = |part| matches!(part, Component::ParentDir);
    if path.is_absolute() {
        let inside = |folder: io::Result<PathBuf>| folder.is_ok_and(|folder| path.starts_with(folder));
        return path.components().any(up) || !(inside(std::path::absolute(folder)) || inside(fs::canonicalize(folder)));
    }
    if names::is_windows_absolute(name) {
        return true;
    }
    let mut depth = 0_usize;
    path.components().any(|part| match part {
        Component::Prefix(_) | Component::RootDir => true,
        Component::CurDir => false,
        Component::Normal(_) => {
            depth += 1;
            false
        }
        Component::ParentDir => match depth.checked_sub(1) {
            Some(less) => {
                depth = less;
                false
            }
            None => true,
        },
    })
}

/// Advice for a folder that is not a data set; if it contains images, how to find their cameras.
pub(crate) fn how_to_begin(folder: &Path) -> String {
    let images_in = |folder: &Path| image_files(folder).map_or(0, |files| files.len());
    let below = data_sets_below(folder);
    if let Some(first) = below.first() {
        let others = if below.len() > 1 { format!(", one of {} data sets in it", below.len()) } else { String::new() };
        let images = if has_transforms(first) || has_photographs(first) {
            ""
        } else {
            " with the folder of its images by --images"
        };
        return format!("name {}{others}{images}", quoted(first));
    }
    let is_data_set = |folder: &&Path| has_transforms(folder) || !models_of(folder).is_empty();
    if let Some(above) = whole(folder).ancestors().skip(1).take(PARTS).find(is_data_set) {
        return format!("it is part of the data set {}: name that", quoted(above));
    }
    let places = [folder.to_owned(), folder.join(IMAGE_FOLDERS[0]), folder.join("input")];
    if let Some(unreadable) = places.iter().find_map(unreadable_photographs) {
        return format!("it holds {unreadable}");
    }
    match places.iter().map(|place| (images_in(place), place)).find(|(count, _)| *count > 1) {
        None => "name the folder that holds one of them".to_owned(),
        Some((count, images)) => format!(
            "it holds {count} images without camera poses: estimate these first, for example with COLMAP: \
             colmap automatic_reconstructor --workspace_path {} --image_path {} --dense 0",
            quoted(folder),
            quoted(images)
        ),
    }
}

/// The absolute path of a folder, without `..`.
pub(crate) fn whole(folder: &Path) -> PathBuf {
    let goes_up = folder.components().any(|part| part == Component::ParentDir);
    let whole = if goes_up { folder.canonicalize() } else { std::path::absolute(folder) };
    whole.unwrap_or_else(|_| folder.to_owned())
}

/// How deep files are in a data set.
const PARTS: usize = 3;

fn has_transforms(folder: &Path) -> bool {
    [NERFSTUDIO, BLENDER_TRAIN].iter().any(|name| folder.join(name).is_file())
}

/// The data sets below a folder, by absolute paths.
fn data_sets_below(folder: &Path) -> BTreeSet<PathBuf> {
    let mut found = BTreeSet::new();
    walk(&whole(folder), |folder, _| {
        if has_transforms(folder) {
            found.insert(folder.to_owned());
        } else if is_model(folder) {
            found.insert(data_set_of(folder));
        }
    });
    found
}
