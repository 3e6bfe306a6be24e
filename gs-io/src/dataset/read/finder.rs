//! Finds the images of a data set where its names are not those of the files: in another letter
//! case, Unicode form or folder. Only the single file that fits is taken.

use std::{
    collections::{HashMap, HashSet},
    ffi::{OsStr, OsString},
    fs,
    path::{Component, Path, PathBuf},
};

use super::{
    Draft,
    names::{self, folded, without_extension},
    place::{NamePart, Place, find_image},
};
use crate::image::{how_to_convert, is_unreadable};

/// How deep below the data set's folder images are searched that are in none of the usual places, and
/// the most folders that are looked into.
const SEARCH: (usize, usize) = (4, 2_000);

/// The same for the folder above, which may be anything.
const SEARCH_ABOVE: (usize, usize) = (2, 100);

/// Folders of other pictures than photographs, which may be in the plural.
const OTHER_PICTURES: [&str; 3] = ["mask", "depth", "normal"];

/// The most files that a message names.
const NAMED: usize = 3;

/// Finds images.
pub(crate) struct Finder<'a> {
    root: &'a Path,
    files: Vec<PathBuf>,
    place: Option<Place>,
    /// Whether the folder of the images is one that the data set does not name.
    pub(crate) elsewhere: bool,
    /// Whether [`Self::near`] found an image outside of the data set's folder.
    pub(crate) outside: bool,
    folders: Folders,
    /// The file of each image, once the first is asked for.
    found: Option<HashMap<PathBuf, Found>>,
    /// Whether the images need not be in the folder that the data set names.
    anywhere: bool,
}

/// A file that was found.
#[derive(Clone)]
pub(crate) struct Found {
    pub(crate) path: PathBuf,
    /// Whether its name or folder differs from that of the data set.
    pub(crate) renamed: bool,
}

/// The entries of folders, each of which is read once.
#[derive(Default)]
pub(crate) struct Folders(HashMap<PathBuf, Listing>);

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
    /// Decides in which of the `places` the images of the `drafts` are: the first with any of them. If
    /// there is none, the only other folder below one of those in `search`.
    pub(crate) fn new(root: &'a Path, places: &[Place], drafts: &[Draft], search: &[PathBuf]) -> Self {
        let files = files_of(drafts);
        let place = places.iter().find(|place| files.iter().any(|file| place.find(file).is_some())).cloned();
        let (folders, anywhere) = (Folders::default(), search.is_empty());
        let mut finder = Self { root, files, place, elsewhere: false, outside: false, folders, found: None, anywhere };
        if finder.place.is_none() {
            let files = finder.files.clone();
            let mut fits = |place: &&Place| files.iter().any(|file| finder.similar(place, file).len() == 1);
            finder.place = places.iter().find(&mut fits).cloned();
        }
        if finder.place.is_none() {
            let others =
                drafts.iter().flat_map(|draft| [draft.mask.as_deref(), draft.depth.as_ref().map(|d| &*d.path)]);
            let others: HashSet<&Path> = others.flatten().filter_map(Path::parent).collect();
            let folder = search.iter().find_map(|from| only_folder_with(from, &finder.files, &others));
            finder.elsewhere = folder.is_some();
            finder.anywhere |= finder.elsewhere;
            finder.place = folder.map(|folder| Place::new(&folder, "", NamePart::FileName));
        }
        finder
    }

    /// The folder of the images.
    pub(crate) fn place(&self) -> Option<&Place> {
        self.place.as_ref()
    }

    /// Searches for the images of these drafts only.
    pub(crate) fn search_for(&mut self, drafts: &[Draft]) {
        (self.files, self.found) = (files_of(drafts), None);
    }

    /// The image of this name.
    pub(crate) fn find(&mut self, file: &Path) -> Option<Found> {
        if self.found.is_none() {
            self.found = Some(self.find_all());
        }
        self.found.as_ref()?.get(file).cloned()
    }

    /// The files of all images. One that fits several names is the image of the closest, and of none of
    /// them if there are several such.
    fn find_all(&mut self) -> HashMap<PathBuf, Found> {
        let Some(place) = self.place.clone() else { return HashMap::new() };
        let is_at = |path: &Path, named: PathBuf| path == named || is_bare(&named) && path.with_extension("") == named;
        let mut fitting: HashMap<PathBuf, Vec<(u8, PathBuf)>> = HashMap::new();
        for file in self.files.iter().cloned().collect::<HashSet<_>>() {
            let own = if place.part == NamePart::Path { &place.folder } else { self.root };
            let named = |path: &Path| is_at(path, self.root.join(&file)) || is_at(path, own.join(&file));
            let (distance, path) = match place.find(&file) {
                Some(path) => (u8::from(!named(&path)), path),
                None => match self.similar(&place, &file).as_mut_slice() {
                    [path] => (2, std::mem::take(path)),
                    _ => continue,
                },
            };
            fitting.entry(path).or_default().push((distance, file));
        }
        let mut found = HashMap::new();
        for (path, mut files) in fitting {
            files.sort();
            if let [(distance, file), rest @ ..] = &files[..]
                && rest.first().is_none_or(|(next, _)| next > distance)
            {
                let anywhere = self.anywhere && is_at(&path, place.expected(file));
                found.insert(file.clone(), Found { path, renamed: *distance > 0 && !anywhere });
            }
        }
        found
    }

    /// What there is instead of an image that was not found, in words.
    pub(crate) fn near(&mut self, file: &Path) -> Option<String> {
        let place = self.place.clone().unwrap_or_else(|| Place::new(self.root, "", NamePart::Path));
        let similar = self.similar(&place, file);
        if similar.len() > 1 {
            return Some(format!("several files fit: {}", self.list(similar)));
        }
        let (elsewhere, images) = named_alike(self.root, file);
        if !elsewhere.is_empty() {
            return Some(format!("there is {}", self.list(elsewhere)));
        }
        if let Some(photograph) = unreadable_alike(self.root, file) {
            let how = how_to_convert(&photograph);
            return Some(format!("there is {}, which {how}", self.list(vec![photograph])));
        }
        if images == 0 {
            let (above, _) = named_alike(&self.root.join(".."), file);
            self.outside = !above.is_empty();
            return Some(match above.is_empty() {
                true => "there are no images in the data set's folder".to_owned(),
                false => format!("there is {}, but outside of the data set's folder", self.list(above)),
            });
        }
        let folder = place.expected(file).parent()?.to_owned();
        if !folder.is_dir() {
            return Some(format!("there is no folder {}", self.list(vec![folder])));
        }
        let others = self.folders.listing(&folder).stems.values().flatten();
        let others: Vec<_> = others.map(|name| folder.join(name)).collect();
        let (count, first) = (others.len(), others.into_iter().min()?);
        Some(format!("its folder has {}, such as {}", gs_core::counted(count, "other image"), self.list(vec![first])))
    }

    /// The first few of these paths, relative to the data set.
    fn list(&self, mut paths: Vec<PathBuf>) -> String {
        paths.sort();
        let shown = |path: &PathBuf| path.strip_prefix(self.root).unwrap_or(path).display().to_string();
        paths.iter().take(NAMED).map(shown).collect::<Vec<_>>().join(", ")
    }

    /// The files whose path differs from the one in `place` at most in what [`folded`] ignores, and in
    /// the extension.
    fn similar(&mut self, place: &Place, file: &Path) -> Vec<PathBuf> {
        let expected = place.expected(file);
        match expected.strip_prefix(self.root) {
            Ok(path) => self.folders.similar(self.root, path),
            Err(_) => self.folders.similar(&place.folder, expected.strip_prefix(&place.folder).unwrap_or(&expected)),
        }
    }
}

impl Folders {
    /// The image at a path below `root`, or else the only one with a similar path.
    pub(crate) fn image(&mut self, root: &Path, path: &str) -> Option<PathBuf> {
        let path = names::plain(path);
        find_image(&root.join(&path)).or_else(|| self.only_similar(root, Path::new(&path)))
    }

    /// The file at a path below `root`, or else the only one with a similar path and this extension.
    pub(crate) fn file(&mut self, root: &Path, path: &str) -> Option<PathBuf> {
        let plain = names::plain(path);
        let (path, extension) = (root.join(&plain), |path: &Path| path.extension().map(OsStr::to_ascii_lowercase));
        let similar = |folders: &mut Self| folders.only_similar(root, Path::new(&plain));
        match path.is_file() {
            true => Some(path),
            false => similar(self).filter(|found| extension(found) == extension(&path)),
        }
    }

    fn only_similar(&mut self, root: &Path, path: &Path) -> Option<PathBuf> {
        match self.similar(root, path).as_mut_slice() {
            [path] => Some(std::mem::take(path)),
            _ => None,
        }
    }

    fn listing(&mut self, folder: &Path) -> &Listing {
        self.0.entry(folder.to_owned()).or_insert_with(|| Listing::of(folder))
    }

    /// The files whose path below `root` differs at most in what [`folded`] ignores, and in the extension
    /// of an image.
    fn similar(&mut self, root: &Path, path: &Path) -> Vec<PathBuf> {
        let mut parts = Vec::new();
        for part in path.components() {
            match part {
                Component::Normal(name) => parts.push(folded(&name.to_string_lossy())),
                Component::ParentDir => parts.push("..".to_owned()),
                _ => return Vec::new(),
            }
        }
        let mut found = Vec::new();
        self.descend(root.to_owned(), &parts, &mut found);
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

fn files_of(drafts: &[Draft]) -> Vec<PathBuf> {
    drafts.iter().filter_map(|draft| draft.file.clone()).collect()
}

/// Whether a name has no extension of an image.
pub(crate) fn is_bare(file: &Path) -> bool {
    let name = file.to_string_lossy();
    without_extension(&name) == name
}

/// The names of the files and folders in a folder.
pub(crate) fn entries(folder: &Path) -> impl Iterator<Item = OsString> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.file_name())
}

/// The only folder below `from` with any of these images, by their file names, apart from `others`.
/// `None` also where file names are not unique, so that folders matter.
fn only_folder_with(from: &Path, files: &[PathBuf], others: &HashSet<&Path>) -> Option<PathBuf> {
    let wanted: HashSet<String> = files.iter().filter_map(|file| stem(file)).collect();
    if wanted.len() < files.len() {
        return None;
    }
    let parents: HashSet<&Path> =
        files.iter().filter_map(|file| file.parent()).filter(|parent| *parent != Path::new("")).collect();
    let mut folders = Vec::new();
    walk(from, |folder, images| {
        let has = |image: &PathBuf| stem(image).is_some_and(|stem| wanted.contains(&stem));
        let is_named = || parents.iter().any(|parent| folder.ends_with(parent));
        let is_photographs = !has_other_pictures(folder.strip_prefix(from).unwrap_or(folder)) || is_named();
        if is_photographs && !others.contains(folder) && images.iter().any(has) {
            folders.push(folder.to_owned());
        }
    });
    match folders.as_mut_slice() {
        [folder] => Some(std::mem::take(folder)),
        _ => None,
    }
}

/// The [`stem`]s of all photographs below a folder.
pub(crate) fn photographs(from: &Path) -> HashSet<Option<String>> {
    let mut found = HashSet::new();
    walk(from, |folder, images| {
        if !has_other_pictures(folder.strip_prefix(from).unwrap_or(folder)) {
            found.extend(images.iter().map(|image| stem(image)));
        }
    });
    found
}

/// Whether a path leads through a folder of masks, depths or normals, such as `masks` or `mask_2`.
fn has_other_pictures(folder: &Path) -> bool {
    folder.components().any(|part| {
        let name = folded(&part.as_os_str().to_string_lossy());
        let name = name.trim_end_matches(|c: char| c.is_ascii_digit() || c == '_');
        OTHER_PICTURES.contains(&name.strip_suffix('s').unwrap_or(name))
    })
}

/// The files below `from` that have the file name of an image, but for what [`folded`] ignores and the
/// extension; and the number of all images there.
fn named_alike(from: &Path, image: &Path) -> (Vec<PathBuf>, usize) {
    let (wanted, mut found, mut count) = (stem(image), Vec::new(), 0);
    walk(from, |_, images| {
        found.extend(images.iter().filter(|image| stem(image) == wanted).cloned());
        count += images.len();
    });
    (found, count)
}

/// A photograph below `from` that cannot be read, with the file name of an image but for the extension.
fn unreadable_alike(from: &Path, image: &Path) -> Option<PathBuf> {
    let (wanted, mut found) = (stem(image), None);
    walk(from, |folder, _| {
        let mut files = entries(folder).map(|name| folder.join(name)).filter(|file| is_unreadable(file));
        found = found.take().or_else(|| files.find(|file| stem(&file.with_extension("")) == wanted));
    });
    found
}

/// The folded file name without the extension of an image.
pub(crate) fn stem(file: &Path) -> Option<String> {
    let name = folded(&file.file_name()?.to_string_lossy());
    Some(without_extension(&name).to_owned())
}

/// Visits a folder and those below it with the images in each, within the limits of [`SEARCH`] and
/// [`SEARCH_ABOVE`].
pub(crate) fn walk(from: &Path, mut visit: impl FnMut(&Path, &[PathBuf])) {
    let (deepest, most) = if from.ends_with("..") { SEARCH_ABOVE } else { SEARCH };
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
        visit(&folder, &images);
    }
}
