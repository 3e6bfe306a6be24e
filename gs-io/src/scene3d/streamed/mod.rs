//! Streamed SOG, PlayCanvas's format for large scenes: levels of detail of the cells of a binary tree.
//!
//! `lod-meta.json` has the tree: a box for each node, and for each cell its run of Gaussians in a chunk
//! for each level, 0 being the finest. A chunk is a SOG in a folder below, with the runs of many cells
//! in one level. An environment is a SOG that every view draws.
//!
//! Errors are in world units where `errorUnit` is `"world"`, which only gs writes; others have a unit of
//! their own. Without it, a level's error is guessed from the size of its cell and its number of
//! Gaussians.
//!
//! *Source:* PlayCanvas, "The Streamed SOG format", version 1; checked against
//! `@playcanvas/splat-transform`.

#[cfg(feature = "write")]
mod layout;
mod levels;
mod meta;
#[cfg(feature = "write")]
mod plan;
#[cfg(feature = "write")]
mod tiles;
mod transition;
#[cfg(feature = "write")]
mod write;

use std::{
    fs,
    path::{Path, PathBuf},
    sync::Arc,
};

use gs_core::{LodNode, Scene, Scene3d};

pub use self::levels::LevelsInMemory;
use self::meta::LodMeta;
pub(super) use self::meta::Run;
pub(super) use self::meta::{LEVELS, stays_inside};
#[cfg(feature = "write")]
pub(super) use self::plan::{CELL, Plan};
#[cfg(feature = "write")]
pub use self::write::write_levels_of_parts_3d;
#[cfg(feature = "write")]
pub(super) use self::write::{write, writes_levels};
use super::{
    ConversionLoss, File3d, Format3d, TrainedWith, checked, format_3d,
    source::{FilesInMemory, Source},
    whole::decode_3d_with,
};
use crate::{atomic::read_file, error::Error};

/// The file that describes the others.
pub(super) const META: &str = "lod-meta.json";

pub(super) const WHAT: &str = "a streamed SOG";

/// A file with levels of detail, of which any level of any cell can be read.
///
/// Of a streamed SOG, chunks are read when a level in them is. A RAD with a tree is in memory as a whole, with about
/// twice the Gaussians of its finest level.
#[derive(Debug, Clone)]
pub struct LodFile3d {
    path: PathBuf,
    bytes: u64,
    chunks: Vec<Chunk>,
    environment: Option<PathBuf>,
    /// The run of each cell in each level, in the order of the tree; `None` where it has no Gaussians.
    cells: Vec<Vec<Option<Run>>>,
    tree: LodNode,
    in_memory: Option<Arc<InMemory>>,
}

/// All levels of a file.
#[derive(Debug)]
pub(super) struct InMemory {
    /// The file without its Gaussians.
    pub(super) file: File3d,
    /// The Gaussians of each run, by its `file`.
    pub(super) parts: Vec<Scene3d>,
}

/// A SOG with runs of cells.
#[derive(Debug, Clone)]
struct Chunk {
    path: PathBuf,
    /// Number of its Gaussians according to the tree.
    gaussians: usize,
}

impl LodFile3d {
    /// Opens a `lod-meta.json`, or a RAD with a tree, and checks it; `None` for a scene without levels of detail. Of a
    /// streamed SOG, reads none of the chunks.
    ///
    /// # Errors
    /// [`Error::Missing`], [`Error::NotAFile`] or [`Error::Read`]; those of [`read_3d`](crate::read_3d) for a RAD;
    /// [`Error::Damaged`] for
    /// a tree with a missing child, bounds that are not finite or do not contain those of a child, counts
    /// that disagree, and chunks outside of its folder;
    /// [`Error::Unusable`] for a later version.
    pub fn open(path: impl AsRef<Path>) -> Result<Option<Self>, Error> {
        let path = path.as_ref();
        let Some(row) = format_3d(path)?.map(Format3d::row) else { return Ok(None) };
        let Some(levels) = row.levels else { return Ok(None) };
        levels(&Source { path, what: row.what, bytes: &read_file(path, row.what)?, beside: None })
    }

    /// Checks the bytes of a `lod-meta.json`. Paths of chunks begin with the folder of `path`.
    ///
    /// # Errors
    /// Those of [`open`](Self::open), except for those of reading.
    pub fn decode(bytes: &[u8], path: &Path) -> Result<Self, Error> {
        Self::parse(&Source { path, what: WHAT, bytes, beside: None })
    }

    pub(super) fn parse(source: &Source<'_>) -> Result<Self, Error> {
        let meta = LodMeta::parse(source)?;
        let (tree, cells) = meta.checked_tree(source)?;
        let folder = source.path.parent().unwrap_or(Path::new(""));
        let gaussians = meta.chunk_sizes(source, &cells)?;
        let chunk = |(name, gaussians): (&String, usize)| Chunk { path: folder.join(name), gaussians };
        Ok(Self {
            path: source.path.to_owned(),
            bytes: source.bytes.len() as u64,
            chunks: meta.filenames.iter().zip(gaussians).map(chunk).collect(),
            environment: meta.environment.map(|name| folder.join(name)),
            cells,
            tree,
            in_memory: None,
        })
    }

    /// A file whose levels are all in memory.
    pub(super) fn in_memory(path: &Path, cells: Vec<Vec<Option<Run>>>, tree: LodNode, all: Arc<InMemory>) -> Self {
        let (path, chunks) = (path.to_owned(), Vec::new());
        Self { path, bytes: all.file.bytes, chunks, environment: None, cells, tree, in_memory: Some(all) }
    }

    /// The bounds of the cells, and the number of Gaussians and the error of each level.
    pub fn tree(&self) -> &LodNode {
        &self.tree
    }

    /// The number of Gaussians of each level, without those of the environment, which all have.
    pub fn counts(&self) -> Vec<usize> {
        let levels = self.cells.first().map_or(0, Vec::len);
        (0..levels).map(|level| self.cells.iter().flat_map(|runs| runs[level]).map(|run| run.count).sum()).collect()
    }

    /// Reads a level of each cell, such as those of [`LodNode::cut`], and the environment, and checks
    /// every value as [`read_3d`](crate::read_3d) does.
    ///
    /// # Errors
    /// Those of [`read_3d`](crate::read_3d) for each chunk; [`Error::Damaged`] for one whose number of
    /// Gaussians is another than in the tree; [`Error::Unusable`] where there are no Gaussians.
    ///
    /// # Panics
    /// Where there is another number of levels than of cells, or a level that is not there.
    pub fn read(&self, levels: &[usize]) -> Result<File3d, Error> {
        checked(self.read_unchecked(levels)?, &self.path)
    }

    fn read_unchecked(&self, levels: &[usize]) -> Result<File3d, Error> {
        let wanted = self.runs(levels);
        if let Some(InMemory { file, parts }) = self.in_memory.as_deref() {
            let mut file = file.clone();
            wanted.iter().for_each(|run| file.scene.append(parts[run.file].clone()));
            return Ok(file);
        }
        let mut whole = File3d::of(Format3d::StreamedSog, Scene3d::default());
        whole.bytes = self.bytes;
        let mut trained_with: Option<TrainedWith> = None;
        let mut add = |path: &Path, runs: Option<&[Run]>, chunk: File3d| {
            match runs {
                Some(runs) => runs.iter().for_each(|run| whole.scene.append(part(&chunk.scene, *run))),
                None => whole.scene.append(chunk.scene),
            }
            whole.bytes += chunk.bytes;
            ConversionLoss::merge(&mut whole.losses, chunk.losses);
            whole.beside.push(path.to_owned());
            whole.beside.extend(chunk.beside);
            trained_with = Some(trained_with.map_or(chunk.trained_with, |all| all.in_common(chunk.trained_with)));
        };
        for runs in wanted.chunk_by(|a, b| a.file == b.file) {
            let chunk = runs[0].file;
            add(&self.chunks[chunk].path, Some(runs), self.chunk(chunk, None)?);
        }
        if let Some(path) = &self.environment {
            add(path, None, read_chunk(path, None)?);
        }
        if whole.scene.is_empty() {
            return Err(Error::empty(&self.path));
        }
        Ok(File3d { trained_with: trained_with.unwrap_or_default(), ..whole })
    }

    /// The run of a level of each cell.
    fn wanted(&self, levels: &[usize]) -> impl Iterator<Item = Option<Run>> {
        assert_eq!(levels.len(), self.cells.len(), "one level for each cell");
        self.cells.iter().zip(levels).map(|(runs, &level)| runs[level])
    }

    /// The runs of a level of each cell, in the order of the chunks.
    fn runs(&self, levels: &[usize]) -> Vec<Run> {
        let mut runs: Vec<Run> = self.wanted(levels).flatten().collect();
        runs.sort_unstable_by_key(|run| (run.file, run.offset));
        runs
    }

    /// Reads a chunk, from the disk or from files in memory.
    fn chunk(&self, file: usize, files: Option<&FilesInMemory>) -> Result<File3d, Error> {
        let Chunk { path, gaussians } = &self.chunks[file];
        let chunk = read_chunk(path, files)?;
        let found = chunk.scene.len();
        match found == *gaussians {
            true => Ok(chunk),
            false => Err(self.damaged(format!("{gaussians} Gaussians in {}", path.display()), found.to_string())),
        }
    }

    /// Reads the finest level of all cells.
    pub(super) fn read_finest(&self) -> Result<File3d, Error> {
        // The size of lod-meta.json is added by the caller, which has read it.
        let file = self.read_unchecked(&vec![0; self.cells.len()])?;
        Ok(File3d { bytes: file.bytes - self.bytes, ..file })
    }

    fn damaged(&self, expected: String, found: String) -> Error {
        let source = Source { path: &self.path, what: WHAT, bytes: &[], beside: None };
        source.damaged(0, expected, found)
    }
}

fn read_chunk(path: &Path, files: Option<&FilesInMemory>) -> Result<File3d, Error> {
    let wanted = "a chunk of a streamed SOG";
    let meta = match files {
        Some(files) => files.get(path).cloned().ok_or_else(|| Error::Missing { path: path.to_owned() })?,
        None => read_file(path, wanted)?,
    };
    decode_3d_with(Format3d::SogFolder, &meta, path, files)
}

/// The Gaussians of a run, which must be there.
fn part(scene: &Scene3d, run: Run) -> Scene3d {
    let (range, len) = (run.offset..run.offset + run.count, scene.sh_len());
    Scene3d {
        means: scene.means[range.clone()].to_vec(),
        log_scales: scene.log_scales[range.clone()].to_vec(),
        rotations: scene.rotations[range.clone()].to_vec(),
        opacity_logits: scene.opacity_logits[range.clone()].to_vec(),
        sh_degree: scene.sh_degree,
        sh: scene.sh[len * range.start..len * range.end].to_vec(),
    }
}

/// The files of chunks that are in the folder of a `lod-meta.json`, or of a `tileset.json`.
pub(super) fn chunk_files(path: &Path) -> Vec<PathBuf> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let entries = |folder: &Path| fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let chunks = entries(folder).filter(|path| path.file_stem().and_then(|n| n.to_str()).is_some_and(is_chunk));
    chunks.flat_map(|chunk| if chunk.is_dir() { entries(&chunk).collect() } else { vec![chunk] }).collect()
}

/// Whether a folder has the name of a chunk: level, underscore, number.
fn is_chunk(name: &str) -> bool {
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    name.split_once('_').is_some_and(|(level, number)| is_number(level) && is_number(number))
}
