//! Several images in one command: `gs encode` and `gs fit` of files and folders.
//!
//! All images are listed, and their names compared, before the first is begun. A failure of one does
//! not keep the others from being done.

mod table;
mod workers;

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use gs_io::{image_files, unreadable_photographs};
use serde::Serialize;

pub(crate) use self::workers::run;
use crate::{failure::Failure, terminal::output::printable};

/// An image of several.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct BatchImage {
    /// The image file.
    pub(crate) file: PathBuf,
    /// The file's name without folder and ending, which its result has, too.
    pub(crate) name: String,
}

impl BatchImage {
    fn new(file: PathBuf) -> Result<Self, Failure> {
        let name = file.file_stem().map(|name| name.to_string_lossy().into_owned());
        let name = name.ok_or_else(|| Failure::usage("is no name of an image").at(file.display()))?;
        Ok(Self { file, name })
    }
}

/// The image, for messages.
pub(crate) fn shown(file: &Path) -> String {
    printable(&file.display().to_string()).into_owned()
}

/// The images that arguments name: files, and all images in folders, without folders in them. `None`
/// where that is a single file or nothing.
pub(crate) fn several(arguments: &[PathBuf]) -> Result<Option<Vec<BatchImage>>, Failure> {
    if arguments.len() < 2 && !arguments.iter().any(|argument| argument.is_dir()) {
        return Ok(None);
    }
    let mut images = Vec::new();
    for argument in arguments {
        let files = match argument.is_dir() {
            true => image_files(argument)?,
            false => vec![argument.clone()],
        };
        if files.is_empty() {
            let failure = Failure::failed("there is no image in this folder").at(argument.display());
            let unreadable = unreadable_photographs(argument).map(|unreadable| format!("it holds {unreadable}"));
            return Err(
                failure.hint(unreadable.as_deref().unwrap_or("name one whose files end in .png, .jpg or the like"))
            );
        }
        images.extend(files.into_iter().map(BatchImage::new).collect::<Result<Vec<_>, _>>()?);
    }
    check_names(&images)?;
    Ok(Some(images))
}

/// Fails where two images have one name, also where it differs in case only: on many systems their
/// results would be one file.
fn check_names(images: &[BatchImage]) -> Result<(), Failure> {
    let mut known = BTreeMap::new();
    for image in images {
        if let Some(first) = known.insert(image.name.to_lowercase(), image) {
            let (a, b) = (first.file.display(), image.file.display());
            let message = format_args!("{a} and {b} have one name, {}, so their results would, too", image.name);
            return Err(Failure::usage(message).hint("rename one, or take them in two commands"));
        }
    }
    Ok(())
}

/// What was made of an image.
#[derive(Debug)]
pub(crate) struct Done<T> {
    /// Its line of the table.
    pub(crate) row: Row,
    /// What `--json` prints.
    pub(crate) summary: T,
}

/// A line of the table.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct Row {
    /// Width and height, px.
    pub(crate) size: (u32, u32),
    /// Size of the file.
    pub(crate) bytes: u64,
    pub(crate) gaussians: usize,
    /// PSNR of the 8-bit picture, dB.
    pub(crate) psnr: f64,
    /// Time of fitting or encoding, s.
    pub(crate) seconds: f64,
}

impl Row {
    fn pixels(&self) -> f64 {
        f64::from(self.size.0) * f64::from(self.size.1)
    }

    /// Bits per pixel.
    fn bpp(&self) -> f64 {
        self.bytes as f64 * 8.0 / self.pixels()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(arguments: &[PathBuf]) -> Option<Vec<String>> {
        several(arguments).unwrap().map(|images| images.into_iter().map(|image| image.name).collect())
    }

    #[test]
    fn folders_and_further_files_make_several_images() {
        let place = tempfile::tempdir().unwrap();
        let path = |name: &str| place.path().join(name);
        for folder in ["photos", "empty"] {
            std::fs::create_dir(path(folder)).unwrap();
        }
        for file in ["photos/b.jpg", "photos/a.png", "photos/notes.txt", "c.png"] {
            std::fs::write(path(file), "").unwrap();
        }
        assert_eq!(names(&[]), None);
        assert_eq!(names(&[path("c.png")]), None);
        assert_eq!(names(&[path("photos")]).unwrap(), ["a", "b"]);
        assert_eq!(names(&[path("c.png"), path("photos"), path("missing.gif")]).unwrap(), ["c", "a", "b", "missing"]);
        let line = |arguments: &[PathBuf]| several(arguments).unwrap_err().line().unwrap();
        assert!(line(&[path("empty")]).contains("there is no image in this folder"));
        std::fs::write(path("empty").join("a.HEIC"), "").unwrap();
        assert!(
            line(&[path("empty")]).contains("it holds 1 photograph, such as a.HEIC, which cannot be read: convert")
        );
        let twice = line(&[path("photos"), path("A.gif")]);
        assert!(twice.contains("a.png and ") && twice.contains("A.gif have one name, A"), "{twice}");
    }
}
