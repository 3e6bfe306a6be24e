//! A scene with what is known of its file.

use std::{collections::BTreeMap, path::PathBuf};

use gs_core::{RenderSettings, Scene3d};

use super::{conversion_loss::ConversionLoss, format::Format3d, trained_with::TrainedWith, values::transform};
use crate::WorldFrame;

/// A scene with information about its file.
#[derive(Debug, Clone, PartialEq)]
pub struct File3d {
    /// The Gaussians.
    pub scene: Scene3d,
    /// The format of the file.
    pub format: Format3d,
    /// Size of the file and of the files it refers to, bytes.
    pub bytes: u64,
    /// Files that the scene file refers to: buffers of a glTF, images of a SOG.
    pub beside: Vec<PathBuf>,
    /// What of the file is not in the scene.
    pub losses: Vec<ConversionLoss>,
    /// How the scene was trained, as far as the file says.
    pub trained_with: TrainedWith,
    /// All settings that the scene is rendered with; a checkpoint has them, scene files do not.
    pub settings: Option<RenderSettings>,
}

impl File3d {
    /// A scene of which nothing else is known.
    pub fn of(format: Format3d, scene: Scene3d) -> Self {
        let (beside, losses, trained_with) = (Vec::new(), Vec::new(), TrainedWith::default());
        Self { scene, format, bytes: 0, beside, losses, trained_with, settings: None }
    }

    /// The file with the further files that were read for it, and their sizes.
    pub(crate) fn beside(self, files: BTreeMap<PathBuf, u64>) -> Self {
        let bytes = files.values().fold(0_u64, |sum, bytes| sum.saturating_add(*bytes));
        Self { bytes, beside: files.into_keys().collect(), ..self }
    }

    /// Takes the scene into another frame, such as that of a data set to train it with.
    pub fn move_to(&mut self, frame: WorldFrame) {
        move_scene(&mut self.scene, &self.trained_with.frame, &frame);
        self.trained_with.frame = frame;
    }
}

/// The result of writing a scene.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Written3d {
    /// The format of the file.
    pub format: Format3d,
    /// What of the scene is not in the file.
    pub losses: Vec<ConversionLoss>,
    /// The further files: the separate buffer of a glTF, the images of a SOG in a folder.
    pub beside: Vec<PathBuf>,
    /// The number in the scene of each Gaussian in the file, where the format sorts them.
    pub order: Option<Vec<u32>>,
}

/// The files that [`write_3d`](super::write_3d) writes.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Encoded3d {
    /// The content of the file.
    pub bytes: Vec<u8>,
    /// The further files.
    pub beside: Vec<(PathBuf, Vec<u8>)>,
    /// What [`write_3d`](super::write_3d) returns.
    pub written: Written3d,
}

impl Encoded3d {
    /// A single file.
    pub(crate) fn of(format: Format3d, bytes: Vec<u8>, losses: Vec<ConversionLoss>) -> Self {
        Self { bytes, beside: Vec::new(), written: Written3d { format, losses, beside: Vec::new(), order: None } }
    }

    /// The file with further ones.
    pub(crate) fn beside(mut self, files: Vec<(PathBuf, Vec<u8>)>) -> Self {
        self.written.beside = files.iter().map(|(path, _)| path.clone()).collect();
        Self { beside: files, ..self }
    }
}

/// Takes a scene from one frame to another.
pub fn move_scene(scene: &mut Scene3d, from: &WorldFrame, to: &WorldFrame) {
    if from != to {
        transform(scene, &from.to(to));
    }
}
