//! The image files of a folder.

use std::{
    fs,
    path::{Path, PathBuf},
};

use crate::error::Error;

/// Endings of image files, in lower case.
const ENDINGS: [&str; 13] =
    ["png", "jpg", "jpeg", "webp", "tif", "tiff", "bmp", "gif", "ppm", "pgm", "pbm", "pnm", "pam"];

/// Whether a file's name ends as an image's does, in letters of any case.
fn is_named_as_image(file: &Path) -> bool {
    let ending = file.extension().map(|ending| ending.to_string_lossy().to_lowercase());
    ending.is_some_and(|ending| ENDINGS.contains(&ending.as_str()))
}

/// The files in a folder, without those of folders in it, whose names end as an image's do; sorted.
/// Names that begin with a dot are left out.
///
/// # Errors
/// [`Error::Read`] where the folder cannot be read.
pub fn image_files(folder: impl AsRef<Path>) -> Result<Vec<PathBuf>, Error> {
    let folder = folder.as_ref();
    let failed = |source| Error::read(folder, source);
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        let path = entry.path();
        if !entry.file_name().to_string_lossy().starts_with('.') && is_named_as_image(&path) && path.is_file() {
            files.push(path);
        }
    }
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
