//! Finds images: the folders of a data set, and file names without extension or with another one.

use std::{
    cell::LazyCell,
    collections::{HashMap, HashSet},
    fs, io,
    path::{Component, Path, PathBuf},
};

use super::{
    finder::{photographs, stem},
    names::{self, EXTENSIONS},
};
use crate::{dataset::DatasetSettings, error::Error};

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

    /// The usual folders of images whose names are paths below them, or the one that the settings name.
    pub(crate) fn usual(root: &Path, settings: &DatasetSettings) -> Result<Vec<Self>, Error> {
        let usual = || IMAGE_FOLDERS.iter().chain(&[""]).map(|name| Self::new(root, name, NamePart::Path)).collect();
        Ok(Self::chosen(root, settings, NamePart::Path)?.map_or_else(usual, |place| vec![place]))
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

/// Takes absolute paths of another machine for those of the files inside the folder `root` that end alike,
/// and returns the paths that were replaced. Images without such a file, or with one that fits several of
/// them, keep their own folders, to be searched for, if there is a photograph of the name.
pub(crate) fn localize(root: &Path, images: &mut [&mut String], settings: &DatasetSettings) -> Vec<Option<String>> {
    let found: Vec<Option<String>> = images.iter().map(|name| ending_inside(root, name, settings)).collect();
    let mut uses: HashMap<String, HashSet<String>> = HashMap::new();
    for (tail, name) in found.iter().zip(&*images).filter_map(|(tail, name)| Some((tail.clone()?, name))) {
        uses.entry(tail).or_default().insert(names::plain(name));
    }
    let photographs = LazyCell::new(|| photographs(root));
    let is_alone = |tail: &String| uses.get(tail).is_some_and(|names| names.len() == 1);
    let replace = |(name, tail): (&mut &mut String, &Option<String>)| {
        let is_there = |parts: &String| photographs.contains(&stem(Path::new(parts)));
        let parts = || is_foreign(root, name, settings).then(|| relative(name)).filter(is_there);
        let new = tail.clone().filter(is_alone).or_else(parts)?;
        Some(std::mem::replace(*name, new))
    };
    images.iter_mut().zip(&found).map(replace).collect()
}

/// Whether a path is absolute, leads out of the folder `root`, and may not be followed there or leads nowhere.
fn is_foreign(root: &Path, name: &str, settings: &DatasetSettings) -> bool {
    let plain = names::plain(name);
    let is_absolute = Path::new(&plain).is_absolute() || names::is_windows_absolute(name);
    is_absolute && leaves(root, name) && !(settings.allow_outside && find_image(Path::new(&plain)).is_some())
}

/// An absolute path without its root and all above its last `..`.
fn relative(name: &str) -> String {
    let mut parts: Vec<&str> = name.rsplit(['/', '\\']).take_while(|part| *part != "..").collect();
    parts.retain(|part| !(part.is_empty() || *part == "." || part.ends_with(':')));
    parts.reverse();
    parts.join("/")
}

/// The longest end of an absolute path of another machine at which there is a file inside the folder `root`.
pub(crate) fn ending_inside(root: &Path, name: &str, settings: &DatasetSettings) -> Option<String> {
    let whole = Some(relative(name)).filter(|_| is_foreign(root, name, settings))?;
    let mut ends = std::iter::successors(Some(whole.as_str()), |end| Some(end.split_once('/')?.1));
    ends.find(|end| !end.is_empty() && find_image(&root.join(end)).is_some()).map(str::to_owned)
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
    let depth = path.components().try_fold(0_usize, |depth, part| match part {
        Component::Normal(_) => Some(depth + 1),
        Component::CurDir => Some(depth),
        Component::ParentDir => depth.checked_sub(1),
        Component::Prefix(_) | Component::RootDir => None,
    });
    depth.is_none()
}

/// The absolute path of a folder, without `..`.
pub(crate) fn whole(folder: &Path) -> PathBuf {
    let goes_up = folder.components().any(|part| part == Component::ParentDir);
    let whole = if goes_up { folder.canonicalize() } else { std::path::absolute(folder) };
    whole.unwrap_or_else(|_| folder.to_owned())
}

/// Folders below which images are searched that are in none of the usual ones.
pub(crate) fn search_folders(root: &Path, settings: &DatasetSettings) -> Vec<PathBuf> {
    match (&settings.image_folder, settings.allow_outside) {
        (Some(_), _) => Vec::new(),
        (None, false) => vec![root.to_owned()],
        (None, true) => vec![root.to_owned(), root.join("..")],
    }
}
