//! The target of a fit: an image file, or the paper's image.

use std::path::{Path, PathBuf};

use gs_core::Image;
use gs_io::read_image_on;
use gs_train::{Preset, paper_target};

use super::batch::shown;
use crate::{flags::values::Color, terminal::output::printable};

/// The target and where it is from.
#[derive(Debug)]
pub(crate) struct FitImage {
    pub(crate) image: Image,
    /// The image's file; `None` for the paper's circle and square.
    pub(crate) file: Option<PathBuf>,
    /// The colour behind its transparent pixels; `None` if it has none.
    pub(crate) behind: Option<Color>,
    /// Remarks about the file, one line each.
    pub(crate) remarks: Vec<String>,
}

impl FitImage {
    /// Reads the image, with `background` (default: white) behind transparent pixels, or makes the
    /// paper's target.
    pub(crate) fn read(file: Option<&Path>, background: Option<Color>) -> Result<Self, gs_io::Error> {
        let Some(path) = file else {
            return Ok(Self { image: paper_target(), file: None, behind: None, remarks: Vec::new() });
        };
        let behind = background.unwrap_or(Color([1.0; 3]));
        let loaded = read_image_on(path, behind.0)?;
        let transparent = loaded.had_alpha;
        let mut remarks: Vec<String> =
            loaded.remarks.iter().map(|remark| format!("note: {}", printable(&remark.to_string()))).collect();
        remarks.extend(
            transparent
                .then(|| format!("note: transparent pixels are fitted as they look on {behind} (--background R,G,B)")),
        );
        Ok(Self { image: loaded.image, file: Some(path.to_owned()), behind: transparent.then_some(behind), remarks })
    }

    /// A small image in place of one that is not read yet, to check settings with.
    pub(crate) fn stand_in(file: &Path) -> Self {
        Self { image: paper_target(), file: Some(file.to_owned()), behind: None, remarks: Vec::new() }
    }

    /// The default preset.
    pub(super) fn preset(&self) -> Preset {
        if self.file.is_some() { Preset::Standard } else { Preset::Paper }
    }

    /// The name for titles: that of the file, without folders.
    pub(crate) fn title(&self) -> String {
        let name = self.file.as_deref().and_then(Path::file_name);
        name.map_or_else(|| self.name(), |name| name.to_string_lossy().into_owned())
    }

    /// The name for messages: the file's path, or that of the paper's image.
    pub(crate) fn name(&self) -> String {
        self.file.as_deref().map_or_else(|| "circle and square".to_owned(), shown)
    }
}
