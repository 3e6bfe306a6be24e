//! Levels of a streamed SOG for a camera that moves.

use std::collections::HashMap;

use gs_core::{LodNode, Scene, Scene3d};

use super::{Run, StreamedSog, checked, part, read_chunk};
use crate::error::Error;

/// A level of each cell of a streamed SOG in memory, for cameras that move. Only chunks with cells whose level
/// changes are read, each as a whole; the coarsest levels stay, as cells out of sight return to them.
#[derive(Debug)]
pub struct LevelsInMemory {
    file: StreamedSog,
    environment: Option<Scene3d>,
    parts: HashMap<Run, Scene3d>,
}

impl LevelsInMemory {
    /// Nothing but the tree yet.
    pub fn of(file: StreamedSog) -> Self {
        Self { file, environment: None, parts: HashMap::new() }
    }

    /// The bounds of the cells, and the number of Gaussians and the error of each level.
    pub fn tree(&self) -> &LodNode {
        self.file.tree()
    }

    /// The scene of a level of each cell, such as those of [`LodNode::cut`], with the environment: the
    /// Gaussians of [`StreamedSog::read`] in the same order. Other levels than these and the coarsest leave
    /// the memory.
    ///
    /// # Errors
    /// Those of [`StreamedSog::read`].
    ///
    /// # Panics
    /// Where there is another number of levels than of cells, or a level that is not there.
    pub fn scene(&mut self, levels: &[usize]) -> Result<Scene3d, Error> {
        let wanted = self.file.runs(levels);
        let mut parts = HashMap::with_capacity(wanted.len());
        for runs in wanted.chunk_by(|a, b| a.file == b.file) {
            let is_there = runs.iter().all(|run| self.parts.contains_key(run));
            let chunk = if is_there { None } else { Some(checked(self.file.chunk(runs[0].file)?, &self.file.path)?) };
            parts.extend(runs.iter().filter_map(|run| {
                let read = || Some(part(&chunk.as_ref()?.scene, *run));
                Some((*run, self.parts.remove(run).or_else(read)?))
            }));
        }
        let coarsest = self.file.cells.iter().filter_map(|runs| *runs.last()?);
        parts.extend(coarsest.filter_map(|run| self.parts.remove_entry(&run)));
        self.parts = parts;
        if let (Some(path), None) = (&self.file.environment, &self.environment) {
            self.environment = Some(checked(read_chunk(path)?, path)?.scene);
        }
        let mut scene = Scene3d::default();
        wanted.iter().filter_map(|run| self.parts.get(run)).for_each(|part| scene.append(part.clone()));
        self.environment.iter().for_each(|part| scene.append(part.clone()));
        if scene.is_empty() { Err(Error::empty(&self.file.path)) } else { Ok(scene) }
    }
}
