//! The image files of a folder.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use crate::{error::Error, text::quoted};

/// Endings of image files, in lower case.
const ENDINGS: [&str; 13] =
    ["png", "jpg", "jpeg", "webp", "tif", "tiff", "bmp", "gif", "ppm", "pgm", "pbm", "pnm", "pam"];

/// Endings of photographs that cannot be read, in lower case.
const UNREADABLE: [&str; 15] =
    ["heic", "heif", "avif", "jxl", "dng", "cr2", "cr3", "nef", "nrw", "arw", "raf", "orf", "rw2", "pef", "srw"];

/// How many of the first of [`UNREADABLE`] are HEIC photographs.
const HEIC: usize = 2;

/// Whether a file's name has one of these endings, in letters of any case.
fn ends_in(file: &Path, endings: &[&str]) -> bool {
    let ending = file.extension().map(|ending| ending.to_string_lossy().to_lowercase());
    ending.is_some_and(|ending| endings.contains(&ending.as_str()))
}

/// Whether a file's name ends as that of a photograph that cannot be read.
pub(crate) fn is_unreadable(file: &Path) -> bool {
    ends_in(file, &UNREADABLE)
}

/// How to convert a photograph that cannot be read and those beside it.
pub(crate) fn how_to_convert(photograph: &Path) -> String {
    let all = Path::new("*").with_extension(photograph.extension().unwrap_or_default());
    let all = quoted(&photograph.with_file_name(all));
    format!("cannot be read: convert such files, for example with ImageMagick: magick mogrify -format jpg {all}")
}

/// What to do about a folder with more photographs of kinds that cannot be read, such as HEIC, than
/// of those that can: "4 photographs that cannot be read: ...". `None` for any other folder.
pub fn unreadable_photographs(folder: impl AsRef<Path>) -> Option<String> {
    let readable = image_files(&folder).ok()?.len();
    let files = named(folder.as_ref(), &UNREADABLE).ok()?;
    let first = files.first().filter(|_| files.len() > readable)?;
    let name = first.file_name()?.to_string_lossy();
    Some(format!("{}, such as {name}, which {}", gs_core::counted(files.len(), "photograph"), how_to_convert(first)))
}

/// The HEIC photographs in a folder, without those of folders in it, by their names; sorted. None where the
/// folder cannot be read.
pub fn heic_files(folder: impl AsRef<Path>) -> Vec<PathBuf> {
    named(folder.as_ref(), &UNREADABLE[..HEIC]).unwrap_or_default()
}

/// The files in a folder, without those of folders in it, whose names end as an image's do; sorted.
/// Names that begin with a dot are left out.
///
/// # Errors
/// [`Error::Read`] where the folder cannot be read.
pub fn image_files(folder: impl AsRef<Path>) -> Result<Vec<PathBuf>, Error> {
    named(folder.as_ref(), &ENDINGS).map_err(|source| Error::read(folder.as_ref(), source))
}

/// The files in a folder with one of these endings, sorted, without hidden ones.
fn named(folder: &Path, endings: &[&str]) -> io::Result<Vec<PathBuf>> {
    let mut files = fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect::<io::Result<Vec<_>>>()?;
    let is_hidden = |path: &Path| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
    files.retain(|path| !is_hidden(path) && ends_in(path, endings) && path.is_file());
    files.sort();
    Ok(files)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_are_found_by_their_endings_and_sorted() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["b.PNG", "a.jpeg", "c.txt", ".d.png", "e"] {
            fs::write(folder.path().join(name), "").unwrap();
        }
        fs::create_dir(folder.path().join("f.png")).unwrap();
        let found = image_files(folder.path()).unwrap();
        assert_eq!(found, ["a.jpeg", "b.PNG"].map(|name| folder.path().join(name)));
        assert!(image_files(folder.path().join("nowhere")).unwrap_err().to_string().contains("nowhere"));
    }
}
