//! What poses are found of: photographs in a folder, or frames of a video.

pub(crate) mod heic;
pub(crate) mod photographs;
pub(crate) mod video;

use std::path::Path;

use gs_io::OutputFolder;

use self::{
    heic::Converter,
    photographs::Photographs,
    video::{RECORD, Video},
};
use crate::{error::Error, reporter::Reporter};

/// The input: a folder of photographs, or a video.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum Input {
    /// Photographs.
    Folder(Photographs),
    /// A video, of which the sharpest frames become photographs.
    Video(Video),
}

impl Input {
    /// Finds the photographs of a folder ([`Photographs::find`]), or looks into a video.
    ///
    /// # Errors
    /// Those of [`Photographs::find`]; [`Error::NoConverter`], [`Error::NoFfmpeg`], [`Error::Video`] for a file that is
    /// no video.
    pub fn find(path: &Path) -> Result<Self, Error> {
        if path.is_file() {
            return Video::open(path).map(Self::Video);
        }
        let photographs = Photographs::find(path)?;
        photographs.heic.first().map(|heic| Converter::find(&heic.path)).transpose()?;
        Ok(Self::Folder(photographs))
    }

    /// The files that are read.
    pub fn paths(&self) -> Vec<&Path> {
        match self {
            Self::Folder(photographs) => photographs.paths().collect(),
            Self::Video(video) => vec![&video.path],
        }
    }

    /// The photographs. HEIC photographs are converted into `images` of the folder. Frames of a video are put there,
    /// too, and `frames.json` says when they were taken. With `resume`, those of an earlier run stay.
    ///
    /// # Errors
    /// [`Error::Video`] for a video that gives no photographs, [`Error::Cancelled`], and those of files.
    pub fn photographs(
        &self,
        (folder, resume): (&OutputFolder, bool),
        reporter: &mut dyn Reporter,
    ) -> Result<Photographs, Error> {
        match self {
            Self::Folder(photographs) => {
                if !folder.claimed(RECORD).is_empty() {
                    folder.remove(RECORD)?;
                }
                photographs.clone().converted((folder, resume), reporter)
            }
            Self::Video(video) => video.photographs((folder, resume), reporter),
        }
    }
}
