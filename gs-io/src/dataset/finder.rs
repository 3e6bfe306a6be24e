//! Finds the images of a data set where its names are not those of the files: in another letter
//! case, Unicode form or folder. Only the single file that fits is taken.

use std::{
    collections::{HashMap, HashSet},
    ffi::OsString,
    fs,
    path::{Component, Path, PathBuf},
};

use super::{
    names::{folded, without_extension},
    place::{NamePart, Place},
};

/// How deep below a folder images are searched that are in none of the usual places, and the most
/// folders that are looked into.
const SEARCH: (usize, usize) = (4, 2_000);

/// The most files that a message names.
const NAMED: usize = 3;

/// Finds images.
pub(super) struct Finder<'a> {
    root: &'a Path,
    place: Option<Place>,
    /// Whether the folder of the images is one that the data set does not name.
    pub(super) elsewhere: bool,
    listings: HashMap<PathBuf, Listing>,
}

/// A file that was found.
pub(super) struct Found {
    pub(super) path: PathBuf,
    /// Whether its name differs from that of the data set.
    pub(super) renamed: bool,
}

/// The entries of a folder by their [`folded`] names, whole and without the extension of an image.
#[derive(Default)]
struct Listing {
    whole: HashMap<String, Vec<OsString>>,
    stems: HashMap<String, Vec<OsString>>,
}

impl Listing {
    fn of(folder: &Path) -> Self {
        let mut listing = Self::default();
        for name in entries(folder) {
            let whole = folded(&name.to_string_lossy());
            let stem = without_extension(&whole);
            if stem.len() < whole.len() {
                listing.stems.entry(stem.to_owned()).or_default().push(name.clone());
            }
            listing.whole.entry(whole).or_default().push(name);
        }
        listing
    }

    /// The entries of a name, the closest form first.
    fn entries(&self, name: &str) -> &[OsString] {
        let forms = [self.whole.get(name), self.stems.get(name), self.stems.get(without_extension(name))];
        forms.into_iter().flatten().next().map_or(&[], Vec::as_slice)
    }
}

impl<'a> Finder<'a> {
    /// Decides in which of the `places` the images `files` are: the first with any of them. If there
    /// is none, and `search` allows it, the only folder below one of its folders.
    pub(super) fn new(root: &'a Path, places: &[Place], files: &[&Path], search: &[PathBuf]) -> Self {
        let place = places.iter().find(|place| files.iter().any(|file| place.find(file).is_some())).cloned();
        let mut finder = Self { root, place, elsewhere: false, listings: HashMap::new() };
        if finder.place.is_none() {
            let mut fits = |place: &&Place| files.iter().any(|file| finder.similar(place, file).len() == 1);
            finder.place = places.iter().find(&mut fits).cloned();
        }
        if finder.place.is_none() {
            let folder = search.iter().find_map(|from| only_folder_with(from, files));
            finder.elsewhere = folder.is_some();
            finder.place = folder.map(|folder| Place::new(&folder, "", NamePart::FileName));
        }
        finder
    }

    /// The folder of the images.
    pub(super) fn place(&self) -> Option<&Place> {
        self.place.as_ref()
    }

    /// The image of this name.
    pub(super) fn find(&mut self, file: &Path) -> Option<Found> {
        let place = self.place.clone()?;
        if let Some(path) = place.find(file) {
            return Some(Found { path, renamed: false });
        }
        match self.similar(&place, file).as_mut_slice() {
            [path] => Some(Found { path: std::mem::take(path), renamed: true }),
            _ => None,
        }
    }

    /// What there is instead of an image that was not found, in words.
    pub(super) fn near(&mut self, file: &Path) -> Option<String> {
        let shown = |root: &Path, path: &PathBuf| path.strip_prefix(root).unwrap_or(path).display().to_string();
        let list = |paths: &[PathBuf], root: &Path| -> String {
            paths.iter().take(NAMED).map(|path| shown(root, path)).collect::<Vec<_>>().join(", ")
        };
        let place = self.place.clone().unwrap_or_else(|| Place::new(self.root, "", NamePart::Path));
        let similar = self.similar(&place, file);
        if similar.len() > 1 {
            return Some(format!("several files fit: {}", list(&similar, self.root)));
        }
        let (mut elsewhere, mut images) = (Vec::new(), 0);
        walk(self.root, |_, files| {
            elsewhere.extend(named_alike(files, file));
            images += files.len();
        });
        if images == 0 {
            walk(&self.root.join(".."), |_, files| elsewhere.extend(named_alike(files, file)));
            elsewhere.sort();
            return Some(match elsewhere.is_empty() {
                true => "there are no images in the data set's folder".to_owned(),
                false => format!("there is {}, but outside of the data set's folder", list(&elsewhere, self.root)),
            });
        }
        if !elsewhere.is_empty() {
            elsewhere.sort();
            return Some(format!("there is {}", list(&elsewhere, self.root)));
        }
        let folder = place.expected(file).parent()?.to_owned();
        if !folder.is_dir() {
            return Some(format!("there is no folder {}", shown(self.root, &folder)));
        }
        let listing = self.listing(&folder);
        let mut images: Vec<_> = listing.stems.values().flatten().map(|name| folder.join(name)).collect();
        images.sort();
        let first = images.first()?;
        Some(format!(
            "its folder has {}, such as {}",
            gs_core::counted(images.len(), "other image"),
            shown(self.root, first)
        ))
    }

    fn listing(&mut self, folder: &Path) -> &Listing {
        self.listings.entry(folder.to_owned()).or_insert_with(|| Listing::of(folder))
    }

    /// The files whose path differs from the one in `place` at most in what [`folded`] ignores, and in
    /// the extension.
    fn similar(&mut self, place: &Place, file: &Path) -> Vec<PathBuf> {
        let expected = place.expected(file);
        let (start, path) = match (expected.strip_prefix(self.root), expected.strip_prefix(&place.folder)) {
            (Ok(path), _) => (self.root.to_owned(), path),
            (_, Ok(path)) => (place.folder.clone(), path),
            _ => return Vec::new(),
        };
        let mut parts = Vec::new();
        for part in path.components() {
            match part {
                Component::Normal(name) => parts.push(folded(&name.to_string_lossy())),
                Component::ParentDir => parts.push("..".to_owned()),
                _ => return Vec::new(),
            }
        }
        let mut found = Vec::new();
        self.descend(start, &parts, &mut found);
        found
    }

    fn descend(&mut self, folder: PathBuf, parts: &[String], found: &mut Vec<PathBuf>) {
        let [first, rest @ ..] = parts else { return };
        if first == ".." {
            return self.descend(folder.join(first), rest, found);
        }
        // A file's own name may have the separators of Windows.
        let files: Vec<PathBuf> =
            self.listing(&folder).entries(&parts.join("/")).iter().map(|name| folder.join(name)).collect();
        found.extend(files.into_iter().filter(|path| path.is_file()));
        if rest.is_empty() {
            return;
        }
        let folders = self.listing(&folder).whole.get(first).cloned().unwrap_or_default();
        for name in folders {
            self.descend(folder.join(name), rest, found);
        }
    }
}

/// The names of the files and folders in a folder.
fn entries(folder: &Path) -> impl Iterator<Item = OsString> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.file_name())
}

/// The only folder below `from` with any of these images, by their file names. `None` also where
/// file names are not unique, so that folders matter.
fn only_folder_with(from: &Path, files: &[&Path]) -> Option<PathBuf> {
    let wanted: HashSet<String> = files.iter().filter_map(|file| stem(file)).collect();
    if wanted.len() < files.len() {
        return None;
    }
    let mut folders = Vec::new();
    walk(from, |folder, images| {
        if images.iter().filter_map(|image| stem(image)).any(|stem| wanted.contains(&stem)) {
            folders.push(folder.to_owned());
        }
    });
    match folders.as_mut_slice() {
        [folder] => Some(std::mem::take(folder)),
        _ => None,
    }
}

/// The files that have the file name of an image, but for what [`folded`] ignores and the extension.
fn named_alike(files: &[PathBuf], image: &Path) -> Vec<PathBuf> {
    let wanted = stem(image);
    files.iter().filter(|file| stem(file) == wanted).cloned().collect()
}

/// The folded file name without the extension of an image.
fn stem(file: &Path) -> Option<String> {
    let name = folded(&file.file_name()?.to_string_lossy());
    Some(without_extension(&name).to_owned())
}

/// Visits a folder and those below it with the images in each, within the limits of [`SEARCH`].
fn walk(from: &Path, mut visit: impl FnMut(&Path, &[PathBuf])) {
    let (deepest, most) = SEARCH;
    let mut waiting = vec![(from.to_owned(), 0)];
    let mut visited = 0;
    while let Some((folder, depth)) = waiting.pop() {
        visited += 1;
        if visited > most {
            return;
        }
        let mut images = Vec::new();
        for name in entries(&folder) {
            let path = folder.join(&name);
            let name = name.to_string_lossy();
            if without_extension(&name).len() < name.len() {
                images.push(path);
            } else if depth < deepest && !name.starts_with('.') && path.is_dir() {
                waiting.push((path, depth + 1));
            }
        }
        images.sort();
        visit(&folder, &images);
    }
}
