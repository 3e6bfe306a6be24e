//! Reads the three files of a model, binary or text.

use std::path::Path;

use super::{
    ColmapModel,
    binary::{Binary, CAMERAS, IMAGES, POINTS},
    records,
    text::Text,
};
use crate::{
    atomic::read_file,
    dataset::{FILE, Remark},
    error::Error,
};

impl ColmapModel {
    /// Reads the model in a folder: the binary files if there is a `cameras.bin`, else the text
    /// files, which are also read where the binary ones are damaged. The file of points is optional.
    ///
    /// # Errors
    /// [`Error::Missing`] or [`Error::Read`]; those of [`Self::from_binary`] or
    /// [`Self::from_text`].
    pub(crate) fn read(folder: &Path) -> Result<Self, Error> {
        Self::read_either(folder).map(|(model, _, _)| model)
    }

    /// Reads the model as [`Self::read`] does, with the extension of its files, and what was wrong with
    /// others.
    pub(super) fn read_either(folder: &Path) -> Result<(Self, &'static str, Option<Remark>), Error> {
        let has = |extension| folder.join("cameras").with_extension(extension).is_file();
        if !has("bin") {
            return Self::read_with(folder, "txt").map(|model| (model, "txt", None));
        }
        match Self::read_with(folder, "bin") {
            Ok(model) => Ok((model, "bin", None)),
            Err(error @ (Error::Damaged { .. } | Error::Missing { .. })) if has("txt") => {
                let Ok(model) = Self::read_with(folder, "txt") else { return Err(error) };
                Ok((model, "txt", Some(Remark::TextModel { error: error.to_string() })))
            }
            Err(error) => Err(error),
        }
    }

    fn read_with(folder: &Path, extension: &str) -> Result<Self, Error> {
        let bytes = |name: &str| read_file(&folder.join(name).with_extension(extension), FILE);
        let cameras = bytes("cameras")?;
        if cameras.is_empty() && extension == "bin" {
            // The fault to name, even where other files are missing.
            Self::from_binary(folder, &cameras, &[], None)?;
        }
        let images = bytes("images")?;
        let points = match bytes("points3D") {
            Err(Error::Missing { .. }) => None,
            other => Some(other?),
        };
        let parse = if extension == "bin" { Self::from_binary } else { Self::from_text };
        parse(folder, &cameras, &images, points.as_deref())
    }

    /// The model in the bytes of `cameras.bin`, `images.bin` and `points3D.bin`; `folder` is for
    /// messages. Memory is limited by their lengths, not by the counts they claim.
    ///
    /// # Errors
    /// [`Error::Damaged`] where a file ends early or claims more than it can contain,
    /// [`Error::Unusable`] for an unknown camera model.
    pub(crate) fn from_binary(
        folder: &Path,
        cameras: &[u8],
        images: &[u8],
        points: Option<&[u8]>,
    ) -> Result<Self, Error> {
        let file = |name: &str| folder.join(name).with_extension("bin");
        let points = points.map(|bytes| records::points(Binary::new(&file("points3D"), bytes, POINTS)?));
        Ok(Self {
            points: points.transpose()?.unwrap_or_default(),
            cameras: records::cameras(Binary::new(&file("cameras"), cameras, CAMERAS)?)?,
            images: records::images(Binary::new(&file("images"), images, IMAGES)?)?,
        })
    }

    /// The model in the bytes of `cameras.txt`, `images.txt` and `points3D.txt`; `folder` is for
    /// messages.
    ///
    /// # Errors
    /// Those of [`Self::from_binary`].
    pub(crate) fn from_text(
        folder: &Path,
        cameras: &[u8],
        images: &[u8],
        points: Option<&[u8]>,
    ) -> Result<Self, Error> {
        let file = |name: &str| folder.join(name).with_extension("txt");
        let points = points.map(|bytes| records::points(Text::new(&file("points3D"), bytes)?));
        Ok(Self {
            points: points.transpose()?.unwrap_or_default(),
            cameras: records::cameras(Text::new(&file("cameras"), cameras)?)?,
            images: records::images(Text::new(&file("images"), images)?)?,
        })
    }
}
