//! `gs render --max-gaussians`: the levels of a streamed SOG that a view needs.

use std::path::Path;

use gs_core::{Camera, LodCut, Scene as _};
use gs_io::{File3d, StreamedSog, format_3d};

use crate::{failure::Failure, files::scene, terminal::output};

/// The largest error of a part of the scene that is not drawn finer, px.
const ERROR_PX: f32 = 1.0;

/// A streamed SOG, and how many of its Gaussians may be drawn.
pub(super) struct Lod {
    file: StreamedSog,
    budget: usize,
}

impl Lod {
    /// Opens a streamed SOG.
    pub(super) fn open(path: &Path, budget: u32) -> Result<Self, Failure> {
        let path = scene::file_of(path);
        if format_3d(&path)? != Some(gs_io::Format3d::StreamedSog) {
            let failure =
                Failure::usage("--max-gaussians is for streamed SOG, which has levels of detail").at(path.display());
            return Err(failure.hint("write one with gs convert SCENE FOLDER/lod-meta.json"));
        }
        Ok(Self { file: StreamedSog::open(path).map_err(Failure::of_scene)?, budget: budget as usize })
    }

    /// The coarsest levels, which show where the scene is.
    pub(super) fn coarsest(&self) -> Result<File3d, Failure> {
        self.file.read(&self.cut(&[])?.levels).map_err(Failure::of_scene)
    }

    /// The levels that these cameras need.
    pub(super) fn read(&self, cameras: &[Camera]) -> Result<File3d, Failure> {
        let LodCut { levels, error_px, .. } = self.cut(cameras)?;
        let file = self.file.read(&levels).map_err(Failure::of_scene)?;
        let (drawn, all) = (file.scene.len(), self.file.counts().first().copied().unwrap_or(0));
        output::note(format_args!(
            "drawing {drawn} Gaussians in place of {all}, with an error of up to {error_px:.2} px"
        ));
        if drawn > self.budget {
            output::note("note: the coarsest levels and the surroundings have more Gaussians than --max-gaussians");
        }
        Ok(file)
    }

    fn cut(&self, cameras: &[Camera]) -> Result<LodCut, Failure> {
        Ok(self.file.tree().cut(cameras, self.budget, ERROR_PX)?)
    }
}
