//! Where photographs are: the folders of a data set, and names that lack an extension or have an old one.

use std::{
    fs,
    path::{Component, Path, PathBuf},
};

use super::DatasetSettings;
use crate::error::Error;

/// Where photographs are looked for where nothing names a folder, the finest first.
pub(super) const IMAGE_FOLDERS: [&str; 4] = ["images", "images_2", "images_4", "images_8"];

/// Tried, in this order, where a file is named without its extension or with another one.
const EXTENSIONS: [&str; 11] = ["png", "jpg", "jpeg", "PNG", "JPG", "JPEG", "webp", "tif", "tiff", "bmp", "ppm"];

/// A folder in which photographs may be.
#[derive(Debug, Clone)]
pub(super) struct Place {
    pub(super) folder: PathBuf,
    pub(super) part: NamePart,
    /// How many times smaller its photographs are than those that the data set is about.
    pub(super) shrunk: f64,
}

/// What of a photograph's name counts in a folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NamePart {
    /// All of it.
    Path,
    /// What stands after the last slash.
    FileName,
}

impl Place {
    /// The folder that the settings name; `None` where they name none.
    ///
    /// # Errors
    /// [`Error::Missing`] where there is no such folder.
    pub(super) fn chosen(root: &Path, settings: &DatasetSettings, part: NamePart) -> Result<Option<Self>, Error> {
        let Some(name) = &settings.image_folder else { return Ok(None) };
        let folder = root.join(name);
        fs::metadata(&folder).map_err(|source| Error::read(&folder, source))?;
        Ok(Some(Self::new(root, name, part)))
    }

    /// A folder whose name ends in `_4` has photographs a quarter of the size.
    pub(super) fn new(root: &Path, name: &str, part: NamePart) -> Self {
        let shrunk = name.rsplit_once('_').and_then(|(_, factor)| factor.parse::<u32>().ok()).filter(|f| *f > 0);
        Self { folder: root.join(name), part, shrunk: shrunk.map_or(1.0, f64::from) }
    }

    /// The file of a photograph of this name.
    pub(super) fn find(&self, file: &Path) -> Option<PathBuf> {
        let path = match self.part {
            NamePart::Path => self.folder.join(file),
            NamePart::FileName => self.folder.join(file.file_name()?),
        };
        find_image(&path)
    }
}

/// The image at a path, or with the path's name and an extension of its own.
pub(super) fn find_image(path: &Path) -> Option<PathBuf> {
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

/// Whether a name stays below the folder that it is joined to.
pub(super) fn stays_below(name: &Path) -> bool {
    name.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir))
}
