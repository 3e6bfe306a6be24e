//! The images of a study.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use crate::{digest, error::Error, synthetic::SyntheticTarget};
use gs_core::Image;

/// Where images are searched, in this order.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Places {
    /// The data folder that the user has named.
    pub data: Option<PathBuf>,
    /// The folder of the study file.
    pub beside: Option<PathBuf>,
    /// Where images were found before, by their names in the study.
    pub remembered: BTreeMap<String, PathBuf>,
}

/// An image to fit.
#[derive(Debug, Clone, PartialEq)]
pub struct StudyImage {
    /// The name in the study.
    pub name: String,
    /// The file; `None` for a synthetic target.
    pub file: Option<PathBuf>,
    /// The pixels, composited over white.
    pub image: Image,
    /// Digest of size and pixels.
    pub digest: String,
}

impl StudyImage {
    /// Makes the synthetic target of that name, or finds and reads the image file.
    ///
    /// # Errors
    /// [`Error::NoImage`], [`Error::NoTarget`], and [`Error::Io`] where the file is not an image.
    pub fn load(name: &str, places: &Places) -> Result<Self, Error> {
        let (file, image) = match SyntheticTarget::from_name(name) {
            Ok(target) => (None, target.image()),
            Err(_) => {
                let file = find(name, places)?;
                let image = gs_io::read_image(&file)?.image;
                (Some(file), image)
            }
        };
        Ok(Self { name: name.to_owned(), file, digest: digest::of_image(&image), image })
    }

    /// The name without folder and extension.
    pub fn label(&self) -> &str {
        Path::new(&self.name).file_stem().and_then(|stem| stem.to_str()).unwrap_or(&self.name)
    }
}

/// Finds the file under its path or, so that any folder of images can be used, under its bare file
/// name.
fn find(name: &str, places: &Places) -> Result<PathBuf, Error> {
    let path = Path::new(name);
    let folders: Vec<&PathBuf> = places.data.iter().chain(&places.beside).collect();
    let bare = path.file_name().map(Path::new);
    let candidates = folders.iter().flat_map(|folder| [Some(path), bare].into_iter().flatten().map(|p| folder.join(p)));
    let remembered = places.remembered.get(name).cloned();
    candidates.chain(remembered).find(|file| file.is_file()).ok_or_else(|| {
        let looked = folders.iter().map(|folder| folder.display().to_string()).collect::<Vec<_>>().join(" or ");
        // A bare word was probably meant as a synthetic target.
        if path.extension().is_none() && path.components().count() == 1 {
            let known = SyntheticTarget::ALL.map(|target| target.name()).join(", ");
            return Error::NoTarget { image: name.to_owned(), known };
        }
        Error::NoImage {
            image: name.to_owned(),
            looked: if looked.is_empty() { "any folder".to_owned() } else { looked },
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_are_found_with_and_without_their_folder() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("kodak");
        std::fs::create_dir(&folder).unwrap();
        gs_io::write_png(folder.join("a.png"), &Image::filled(3, 2, [0.25; 3]).unwrap()).unwrap();
        for data in [place.path(), &folder] {
            let places = Places { data: Some(data.to_owned()), ..Places::default() };
            let target = StudyImage::load("kodak/a.png", &places).unwrap();
            assert_eq!((target.label(), target.image.size()), ("a", (3, 2)));
        }
        let lost = StudyImage::load("kodak/b.png", &Places { data: Some(folder), ..Places::default() })
            .unwrap_err()
            .to_string();
        assert!(lost.contains("kodak/b.png: no such file in ") && lost.contains("--data"), "{lost}");
    }

    #[test]
    fn synthetic_targets_need_no_file_and_the_error_lists_them() {
        let unknown = StudyImage::load("papier", &Places::default()).unwrap_err().to_string();
        for synthetic in SyntheticTarget::ALL {
            let target = StudyImage::load(synthetic.name(), &Places::default()).unwrap();
            assert_eq!((&target.image, target.label(), &target.file), (&synthetic.image(), synthetic.name(), &None));
            assert!(unknown.contains(synthetic.name()), "{unknown}");
        }
    }
}
