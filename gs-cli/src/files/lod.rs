//! The levels of detail that views need.

use std::path::Path;

use gs_core::{Camera, LodCut, LodNode, Scene as _};
use gs_io::{File3d, LodFile3d};

use super::scene;
use crate::{failure::Failure, terminal::output};

/// The most Gaussians that a window draws by default.
#[cfg(feature = "viewer")]
const USUAL_BUDGET: u32 = 1_000_000;

/// A file with levels of detail, and how many of its Gaussians may be drawn.
pub(crate) struct Lod {
    file: LodFile3d,
    budget: usize,
}

impl Lod {
    /// Opens a scene with levels of detail.
    pub(crate) fn open(path: &Path, budget: u32) -> Result<Self, Failure> {
        Self::find(path, budget)?.ok_or_else(|| {
            let failure = Failure::usage("--max-gaussians is for levels of detail, and this scene has none");
            let hint = "write them with gs convert SCENE FOLDER/lod-meta.json, or SCENE.rad";
            failure.at(scene::file_of(path).display()).hint(hint)
        })
    }

    /// Opens the scene of a window, if it has levels of detail.
    #[cfg(feature = "viewer")]
    pub(crate) fn for_window(path: &Path, budget: Option<u32>) -> Result<Option<Self>, Failure> {
        match budget {
            None => Self::find(path, USUAL_BUDGET),
            Some(budget) => Self::open(path, budget).map(Some),
        }
    }

    /// The file, and the most Gaussians that are drawn.
    pub(crate) fn levels(&self) -> (&LodFile3d, usize) {
        (&self.file, self.budget)
    }

    /// Number of the Gaussians of the finest levels.
    pub(crate) fn finest(&self) -> usize {
        self.file.counts().first().copied().unwrap_or(0)
    }

    fn find(path: &Path, budget: u32) -> Result<Option<Self>, Failure> {
        let file = LodFile3d::open(scene::file_of(path)).map_err(Failure::of_scene)?;
        Ok(file.map(|file| Self { file, budget: budget as usize }))
    }

    /// The coarsest levels, which show where the scene is.
    pub(crate) fn coarsest(&self) -> Result<File3d, Failure> {
        self.file.read(&self.cut(&[])?.levels).map_err(Failure::of_scene)
    }

    /// The levels that these cameras need.
    pub(crate) fn read(&self, cameras: &[Camera]) -> Result<File3d, Failure> {
        let LodCut { levels, error_px, .. } = self.cut(cameras)?;
        let file = self.file.read(&levels).map_err(Failure::of_scene)?;
        let (drawn, all) = (file.scene.len(), self.finest());
        output::note(format_args!(
            "drawing {drawn} Gaussians in place of {all}, with an error of up to {error_px:.2} px"
        ));
        if drawn > self.budget {
            output::note("note: the coarsest levels and the surroundings have more Gaussians than --max-gaussians");
        }
        Ok(file)
    }

    fn cut(&self, cameras: &[Camera]) -> Result<LodCut, Failure> {
        Ok(self.file.tree().cut(cameras, self.budget, LodNode::USUAL_ERROR_PX)?)
    }
}
