//! Levels of a file for a camera that moves.

use std::{
    borrow::Cow,
    collections::{HashMap, HashSet},
    path::{Path, PathBuf},
};

use glam::Vec3;
use gs_core::{Camera, LodNode, Scene, Scene3d, logit, sigmoid};

use super::{FilesInMemory, LodFile3d, Run, checked, part, read_chunk, transition::Transition};
use crate::{
    error::Error,
    scene3d::{File3d, TrainedWith},
};

/// Levels of detail of a file that are in memory, for cameras that move.
///
/// In memory are the levels that are shown, the coarsest ones, to which cells out of sight return, and as many others
/// as there is room for. A chunk is always decoded as a whole.
///
/// For files on a disk, [`read`](Self::read) reads all that is missing. For files that come over a network,
/// [`missing`](Self::missing) names chunks and [`add`](Self::add) takes them, one after the other. Meanwhile,
/// [`shown`](Self::shown) returns what can be shown.
#[derive(Debug)]
pub struct LevelsInMemory {
    file: LodFile3d,
    environment: Option<Scene3d>,
    parts: HashMap<Run, Part>,
    /// What the chunks so far were trained with.
    trained_with: Option<TrainedWith>,
    /// Most bytes of parts that are neither wanted nor shown nor the coarsest of a cell.
    room: usize,
    /// Number of calls of [`Self::missing`].
    turn: u64,
    /// What its last call wanted.
    wanted: HashSet<Run>,
    /// The levels that were shown last.
    shown: Option<Vec<usize>>,
    transition: Transition,
}

/// A scene whose opacities have this share. On the way from one level to another, the picture is then close to a mix of
/// both pictures.
fn faded(scene: &Scene3d, share: f32) -> Cow<'_, Scene3d> {
    if share == 1.0 {
        return Cow::Borrowed(scene);
    }
    let mut faded = scene.clone();
    faded.opacity_logits.iter_mut().for_each(|opacity| *opacity = logit(share * sigmoid(*opacity)));
    Cow::Owned(faded)
}

/// A scene of all these Gaussians; `None` if there are none.
fn joined(parts: Vec<Cow<'_, Scene3d>>) -> Option<Scene3d> {
    let mut scene = Scene3d::default();
    scene.reserve(parts.iter().map(|part| part.len()).sum());
    parts.into_iter().for_each(|part| scene.append(part.into_owned()));
    (!scene.is_empty()).then_some(scene)
}

/// The Gaussians of a level of a cell.
#[derive(Debug)]
struct Part {
    scene: Scene3d,
    /// The number of the last call of [`LevelsInMemory::missing`] that wanted them. A part that came with the chunk of
    /// another one begins with the number of the call before.
    wanted: u64,
}

impl Part {
    fn bytes(&self) -> usize {
        size_of::<f32>() * self.scene.len() * (3 + 3 + 4 + 1 + 3 * self.scene.sh_len())
    }
}

impl LevelsInMemory {
    /// Begins with the tree alone. Up to `room` bytes are used for levels that are not shown, in addition to the
    /// coarsest ones.
    pub fn of(file: LodFile3d, room: usize) -> Self {
        let (parts, wanted, transition) = (HashMap::new(), HashSet::new(), Transition::default());
        Self { file, environment: None, parts, trained_with: None, room, turn: 0, wanted, shown: None, transition }
    }

    /// The bounds of the cells, and the number of Gaussians and the error of each level.
    pub fn tree(&self) -> &LodNode {
        self.file.tree()
    }

    /// Names the chunks that are missing for a level of each cell, such as the levels of [`LodNode::cut`].
    ///
    /// Chunks in whose place finer levels are shown come first, then those that are nearest to `position`. While
    /// nothing is in memory, the smallest chunks come first. The environment comes last.
    ///
    /// # Panics
    /// If there is not one level for each cell, or a cell has no such level.
    pub fn missing(&mut self, levels: &[usize], position: Vec3) -> Vec<PathBuf> {
        if self.file.in_memory.is_some() {
            return Vec::new();
        }
        self.turn += 1;
        let mut distances: HashMap<usize, f32> = HashMap::new();
        let wanted: Vec<Option<Run>> = self.file.wanted(levels).collect();
        self.wanted = wanted.iter().flatten().copied().collect();
        for (cell, (bounds, _)) in self.file.tree.cells().into_iter().enumerate() {
            let Some(run) = wanted[cell] else { continue };
            if let Some(part) = self.parts.get_mut(&run) {
                part.wanted = self.turn;
                continue;
            }
            // A finer level in its place has more Gaussians than there should be.
            let is_urgent = self.in_place(cell, levels[cell]).is_some_and(|finer| finer < levels[cell]);
            let distance = if is_urgent { 0.0 } else { bounds.distance(position) };
            let nearest = distances.entry(run.file).or_insert(f32::INFINITY);
            *nearest = nearest.min(distance);
        }
        if self.parts.is_empty() {
            distances.iter_mut().for_each(|(chunk, distance)| *distance = self.file.chunks[*chunk].gaussians as f32);
        }
        let mut chunks: Vec<(usize, f32)> = distances.into_iter().collect();
        chunks.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
        let chunks = chunks.into_iter().map(|(chunk, _)| self.file.chunks[chunk].path.clone());
        chunks.chain(self.file.environment.clone().filter(|_| self.environment.is_none())).collect()
    }

    /// Takes a chunk that [`missing`](Self::missing) has named.
    ///
    /// Its `meta.json` and images are read from `files`, or from the disk if that is `None`.
    ///
    /// # Errors
    /// Those of [`LodFile3d::read`].
    ///
    /// # Panics
    /// If the file has no such chunk.
    pub fn add(&mut self, path: &Path, files: Option<&FilesInMemory>) -> Result<(), Error> {
        if self.file.environment.as_deref() == Some(path) {
            self.environment = Some(self.taken(read_chunk(path, files)?)?);
            return Ok(());
        }
        let chunk = self.file.chunks.iter().position(|chunk| chunk.path == path);
        let chunk = chunk.unwrap_or_else(|| panic!("no chunk {}", path.display()));
        let scene = self.taken(self.file.chunk(chunk, files)?)?;
        let runs: Vec<Run> =
            self.file.cells.iter().flatten().flatten().filter(|run| run.file == chunk).copied().collect();
        for run in runs {
            let part = || Part { scene: part(&scene, run), wanted: self.turn.saturating_sub(1) };
            self.parts.entry(run).or_insert_with(part);
        }
        self.make_room();
        Ok(())
    }

    /// The Gaussians of a file, whose values are checked.
    fn taken(&mut self, file: File3d) -> Result<Scene3d, Error> {
        let file = checked(file, &self.file.path)?;
        self.trained_with = Some(self.trained_with.map_or(file.trained_with, |all| all.in_common(file.trained_with)));
        Ok(file.scene)
    }

    /// Reads from the disk the chunks that are missing for a level of each cell, and returns the scene.
    ///
    /// It has the Gaussians of [`LodFile3d::read`] in the same order.
    ///
    /// # Errors
    /// Those of [`LodFile3d::read`].
    ///
    /// # Panics
    /// Those of [`missing`](Self::missing).
    pub fn read(&mut self, levels: &[usize]) -> Result<Scene3d, Error> {
        self.read_missing(levels)?;
        joined(self.shown(levels)).ok_or_else(|| Error::empty(&self.file.path))
    }

    /// Reads as [`read`](Self::read) does, and returns what is drawn [at a time](Self::shown_at).
    ///
    /// # Errors
    /// Those of [`LodFile3d::read`].
    ///
    /// # Panics
    /// Those of [`missing`](Self::missing).
    pub fn read_at(&mut self, levels: &[usize], camera: &Camera, seconds: f64) -> Result<Scene3d, Error> {
        self.read_missing(levels)?;
        joined(self.shown_at(levels, camera, seconds)).ok_or_else(|| Error::empty(&self.file.path))
    }

    fn read_missing(&mut self, levels: &[usize]) -> Result<(), Error> {
        self.missing(levels, Vec3::ZERO).iter().try_for_each(|path| self.add(path, None))
    }

    /// Returns what can be shown in place of a level of each cell, with the environment.
    ///
    /// If all levels are in memory, these are the Gaussians of [`LodFile3d::read`] in the same order. In place of a
    /// level that is not in memory comes the next coarser one that is, or else the next finer one, so there may be more
    /// Gaussians than in the requested levels. If there is no room for all other levels, those that were wanted longest
    /// ago leave the memory.
    ///
    /// # Panics
    /// Those of [`missing`](Self::missing).
    pub fn shown(&mut self, levels: &[usize]) -> Vec<Cow<'_, Scene3d>> {
        self.transition = Transition::default();
        self.shown_with(levels, |_| false, 0.0)
    }

    /// Returns what can be shown at a time, s, on the way to a level of each cell, with the environment.
    ///
    /// In a cell that this camera sees, the level that was shown in the call before fades out for a quarter of a second,
    /// while the next one fades in. So the picture does not jump, and there may be up to twice the Gaussians for that
    /// time. What [`shown`](Self::shown) returns is reached when no cell [is changing](Self::is_changing) any more.
    ///
    /// # Panics
    /// Those of [`missing`](Self::missing).
    pub fn shown_at(&mut self, levels: &[usize], camera: &Camera, seconds: f64) -> Vec<Cow<'_, Scene3d>> {
        let in_sight: Vec<bool> = self.tree().cells().iter().map(|(bounds, _)| bounds.is_in_sight(camera)).collect();
        self.shown_with(levels, |cell| in_sight[cell], seconds)
    }

    /// Whether cells change their levels, so that the next call of [`shown_at`](Self::shown_at) returns something else.
    pub fn is_changing(&self) -> bool {
        self.transition.is_under_way()
    }

    fn shown_with(&mut self, levels: &[usize], fades: impl Fn(usize) -> bool, seconds: f64) -> Vec<Cow<'_, Scene3d>> {
        let in_place: Vec<Option<usize>> = (0..levels.len()).map(|cell| self.in_place(cell, levels[cell])).collect();
        let nothing = |cell: usize| self.file.cells[cell].len() - 1;
        self.shown = Some(in_place.iter().enumerate().map(|(cell, l)| l.unwrap_or_else(|| nothing(cell))).collect());
        let shown = self.transition.at(&in_place, fades, seconds);
        let run = |(cell, level, share): (usize, usize, f32)| Some((self.file.cells[cell][level]?, share));
        let mut shown: Vec<(Run, f32)> = shown.into_iter().filter_map(run).collect();
        shown.sort_unstable_by_key(|(run, _)| (run.file, run.offset));
        self.make_room();
        let parts = shown.iter().filter_map(|(run, share)| Some(faded(self.part(run)?, *share)));
        parts.chain(self.environment.as_ref().map(Cow::Borrowed)).collect()
    }

    /// The level of each cell that was [`shown`](Self::shown) last; the coarsest for a cell that showed nothing.
    pub fn shown_levels(&self) -> Option<&[usize]> {
        self.shown.as_deref()
    }

    /// The level of a cell that is shown for this one: itself, the next coarser one in memory, or the next finer one.
    fn in_place(&self, cell: usize, level: usize) -> Option<usize> {
        let runs = &self.file.cells[cell];
        let is_there = |level: &usize| runs[*level].is_some_and(|run| self.part(&run).is_some());
        // A cell without Gaussians in its level shows none.
        runs[level]?;
        (level..runs.len()).find(is_there).or_else(|| (0..level).rev().find(is_there))
    }

    /// The Gaussians of a run, if they are in memory.
    fn part(&self, run: &Run) -> Option<&Scene3d> {
        match &self.file.in_memory {
            Some(all) => all.parts.get(run.file),
            None => self.parts.get(run).map(|part| &part.scene),
        }
    }

    /// What the chunks so far were trained with.
    pub fn trained_with(&self) -> TrainedWith {
        self.trained_with.unwrap_or_default()
    }

    /// Removes parts that are neither wanted nor shown, until the remaining ones of them fit into the room.
    fn make_room(&mut self) {
        let cells = &self.file.cells;
        let shown = self.transition.levels().filter_map(|(cell, level)| cells[cell][level]);
        let coarsest = cells.iter().filter_map(|runs| *runs.last()?);
        let stay: HashSet<Run> = self.wanted.iter().copied().chain(shown).chain(coarsest).collect();
        let mut others: Vec<(u64, Run, usize)> = self
            .parts
            .iter()
            .filter(|(run, _)| !stay.contains(run))
            .map(|(run, part)| (part.wanted, *run, part.bytes()))
            .collect();
        others.sort_unstable_by_key(|(wanted, run, _)| (*wanted, run.file, run.offset));
        let mut bytes: usize = others.iter().map(|(.., bytes)| bytes).sum();
        for (_, run, size) in others {
            if bytes <= self.room {
                break;
            }
            self.parts.remove(&run);
            bytes -= size;
        }
    }
}
