//! What a fit is to look like: an image file, or the paper's target.

use std::path::{Path, PathBuf};

use gs_core::Image;
use gs_io::{AlphaMode, Transparency, read_image_with};
use gs_train::{Preset, paper_target};

use crate::{output::printable, values::Color};

/// The target and where it is from.
#[derive(Debug)]
pub(crate) struct Target {
    /// Its pixels.
    pub(crate) image: Image,
    /// Its file; none is the paper's circle and square.
    pub(crate) file: Option<PathBuf>,
    /// The colour that its transparent pixels were put on; none where it has none.
    pub(crate) behind: Option<Color>,
    /// What is worth telling about the file, a line each.
    pub(crate) remarks: Vec<String>,
}

impl Target {
    /// Reads the image, with transparent pixels before `background` (white where there is none); or makes the paper's target.
    ///
    /// # Errors
    /// Where the file is no image that can be read.
    pub(crate) fn load(file: Option<&Path>, background: Option<Color>) -> Result<Self, gs_io::Error> {
        let Some(path) = file else {
            return Ok(Self { image: paper_target(), file: None, behind: None, remarks: Vec::new() });
        };
        let behind = background.unwrap_or(Color([1.0; 3]));
        let loaded = read_image_with(path, AlphaMode::Composite(behind.0))?;
        let transparent = loaded.transparency != Transparency::None;
        let mut remarks: Vec<String> =
            loaded.remarks.iter().map(|remark| format!("note: {}", printable(&remark.to_string()))).collect();
        remarks.extend(
            transparent
                .then(|| format!("note: transparent pixels are fitted as they look on {behind} (--background R,G,B)")),
        );
        Ok(Self { image: loaded.image, file: Some(path.to_owned()), behind: transparent.then_some(behind), remarks })
    }

    /// The preset that suits it.
    pub(crate) fn preset(&self) -> Preset {
        if self.file.is_some() { Preset::Standard } else { Preset::Paper }
    }

    /// Its name for titles: that of its file, without folders.
    pub(crate) fn title(&self) -> String {
        let name = self.file.as_deref().and_then(Path::file_name).map(|name| name.to_string_lossy().into_owned());
        name.unwrap_or_else(|| self.name())
    }

    /// Its name for people.
    pub(crate) fn name(&self) -> String {
        match &self.file {
            Some(file) => printable(&file.display().to_string()).into_owned(),
            None => "circle and square".to_owned(),
        }
    }
}
