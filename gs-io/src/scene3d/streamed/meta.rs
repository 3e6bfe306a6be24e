//! `lod-meta.json` of a streamed SOG.

use std::{
    collections::{BTreeMap, HashSet},
    path::{Component, Path},
};

use glam::Vec3;
use gs_core::{Bounds, LodLevel, LodNode};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::{error::Error, scene3d::source::Source, text::utf8_text};

/// The version that is read and written.
pub(super) const VERSION: u64 = 1;

/// The unit of errors that are distances in the world.
pub(super) const WORLD: &str = "world";

/// Most levels of a scene that gs makes; each has half the Gaussians of the one before.
pub(in crate::scene3d) const LEVELS: usize = 7;

/// Most levels: far more than any scene has.
const MAX_LEVELS: usize = 64;

/// Most Gaussians of a chunk: the pixels of the largest image.
const MAX_CHUNK: usize = 1 << 28;

/// The whole file.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct LodMeta {
    pub(super) version: Option<u64>,
    #[serde(default)]
    pub(super) asset: Value,
    /// Number of Gaussians in all levels, and in each.
    pub(super) count: Option<u64>,
    pub(super) counts: Option<Vec<u64>>,
    pub(super) lod_levels: usize,
    /// Whether all cells have errors.
    #[serde(default)]
    pub(super) lod_errors: bool,
    /// The unit of errors, an addition of ours.
    pub(super) error_unit: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) environment: Option<String>,
    pub(super) filenames: Vec<String>,
    pub(super) tree: Node,
}

/// A node with two others, or with the runs of a cell by level.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Node {
    pub(super) bound: Bound,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) children: Option<Vec<Option<Node>>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) lods: Option<BTreeMap<String, Run>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) errors: Option<Vec<f32>>,
}

/// A box. JSON has null for NaN.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Bound {
    min: [Option<f32>; 3],
    max: [Option<f32>; 3],
}

impl From<Bounds> for Bound {
    fn from(bounds: Bounds) -> Self {
        let [min, max] = [bounds.min, bounds.max].map(|corner| corner.to_array().map(Some));
        Self { min, max }
    }
}

impl From<&Bound> for Bounds {
    fn from(bound: &Bound) -> Self {
        let [min, max] = [bound.min, bound.max].map(|corner| Vec3::from_array(corner.map(|n| n.unwrap_or(f32::NAN))));
        Self { min, max }
    }
}

/// Consecutive Gaussians of a chunk.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub(in crate::scene3d) struct Run {
    /// The index of the chunk.
    pub(in crate::scene3d) file: usize,
    pub(in crate::scene3d) offset: usize,
    pub(in crate::scene3d) count: usize,
}

/// The runs of each cell by level.
pub(super) type Cells = Vec<Vec<Option<Run>>>;

impl LodMeta {
    pub(super) fn parse(source: &Source<'_>) -> Result<Self, Error> {
        let text = utf8_text(source.path, source.bytes)?;
        let damaged = |error: serde_json::Error| {
            source.damaged(0, "the lod-meta.json of a streamed SOG", format!("one with: {error}"))
        };
        // Files from before there were versions have none.
        let version = serde_json::from_slice::<Value>(text).map_err(damaged)?["version"].as_u64().unwrap_or(VERSION);
        if version != VERSION {
            return Err(Error::too_new(source.path, source.what, VERSION, version));
        }
        let meta: Self = serde_json::from_slice(text).map_err(damaged)?;
        if !(1..=MAX_LEVELS).contains(&meta.lod_levels) {
            return Err(source.damaged(0, format!("1 to {MAX_LEVELS} levels"), meta.lod_levels.to_string()));
        }
        let mut names = HashSet::new();
        match meta.filenames.iter().chain(&meta.environment).find(|name| !stays_inside(name) || !names.insert(*name)) {
            Some(name) => {
                let found = format!("{:?}", name.chars().take(60).collect::<String>());
                Err(source.damaged(0, "names of files below the folder of lod-meta.json, each once", found))
            }
            None => Ok(meta),
        }
    }

    /// The tree, and the runs of its cells, whose counts agree with those of the levels.
    pub(super) fn checked_tree(&self, source: &Source<'_>) -> Result<(LodNode, Cells), Error> {
        let mut cells = Vec::new();
        let tree = self.node(source, &self.tree, &mut cells)?;
        let sum = |level: usize| cells.iter().flat_map(|runs| runs[level]).map(|run| run.count as u64).sum::<u64>();
        let sums: Vec<u64> = (0..self.lod_levels).map(sum).collect();
        if let Some(counts) = self.counts.as_ref().filter(|&counts| *counts != sums) {
            let counts = &counts[..counts.len().min(MAX_LEVELS)];
            return Err(source.damaged(0, format!("{counts:?} Gaussians in the levels"), format!("{sums:?}")));
        }
        let all: u64 = sums.iter().sum();
        if all > u32::MAX.into() {
            return Err(source.damaged(0, format!("at most {} Gaussians in all levels", u32::MAX), all.to_string()));
        }
        match self.count.filter(|&count| count != all) {
            Some(count) => Err(source.damaged(0, format!("{count} Gaussians in all levels"), all.to_string())),
            None => Ok((tree, cells)),
        }
    }

    fn node(&self, source: &Source<'_>, node: &Node, cells: &mut Cells) -> Result<LodNode, Error> {
        let bounds = bounds(source, &node.bound)?;
        let children = match (&node.children, &node.lods) {
            (Some(children), None) => children,
            (None, Some(lods)) => {
                let runs = self.runs(source, lods)?;
                let levels = self.levels(source, node, &bounds, &runs)?;
                cells.push(runs);
                return Ok(LodNode::Leaf { bounds, levels });
            }
            _ => return Err(source.damaged(0, "nodes with either `children` or `lods`", "one with both or neither")),
        };
        let there: Vec<&Node> = children.iter().flatten().collect();
        if there.len() != 2 || children.len() != 2 {
            return Err(source.damaged(0, "two children of a node", format!("{}", there.len())));
        }
        let children: Result<Vec<_>, Error> = there.into_iter().map(|child| self.node(source, child, cells)).collect();
        let children = children?;
        match children.iter().find(|child| !bounds.contains(child.bounds())) {
            Some(child) => {
                let expected = format!("bounds inside those of the node above, {} to {}", bounds.min, bounds.max);
                Err(source.damaged(0, expected, format!("{} to {}", child.bounds().min, child.bounds().max)))
            }
            None => Ok(LodNode::Inner { bounds, children }),
        }
    }

    /// The runs of a cell by level.
    fn runs(&self, source: &Source<'_>, lods: &BTreeMap<String, Run>) -> Result<Vec<Option<Run>>, Error> {
        let mut runs = vec![None; self.lod_levels];
        for (name, run) in lods {
            let level = name.parse().ok().filter(|&level: &usize| level < runs.len());
            let Some(level) = level else {
                return Err(source.damaged(0, format!("levels below {}", runs.len()), format!("{name:.20?}")));
            };
            if run.file >= self.filenames.len() {
                let expected = format!("chunks below {}, the number of file names", self.filenames.len());
                return Err(source.damaged(0, expected, run.file.to_string()));
            }
            if run.offset > MAX_CHUNK || run.count > MAX_CHUNK {
                let found = format!("{} from {}", run.count, run.offset);
                return Err(source.damaged(0, format!("runs of chunks of at most {MAX_CHUNK} Gaussians"), found));
            }
            runs[level] = Some(*run).filter(|run| run.count > 0);
        }
        Ok(runs)
    }

    fn levels(
        &self,
        source: &Source<'_>,
        node: &Node,
        bounds: &Bounds,
        runs: &[Option<Run>],
    ) -> Result<Vec<LodLevel>, Error> {
        let count = |level: usize| runs[level].map_or(0, |run: Run| run.count);
        let measured = node.errors.as_ref().filter(|_| self.lod_errors && self.error_unit.as_deref() == Some(WORLD));
        let is_wrong = |e: &&Vec<f32>| e.len() != runs.len() || !e.iter().all(|e| *e >= 0.0 && e.is_finite());
        if let Some(errors) = measured.filter(is_wrong) {
            let expected = format!("{} errors of a cell, at least 0", runs.len());
            return Err(source.damaged(0, expected, format!("{} that may be others", errors.len())));
        }
        // The distance of Gaussians on a surface through the cell, relative to that of the finest.
        let spacing = |count: usize| 1.0 / (count.max(1) as f32).sqrt();
        let size = (bounds.max - bounds.min).length().min(f32::MAX);
        let guessed = |level| size * (spacing(count(level)) - spacing(count(0))).max(0.0);
        let error = |level: usize| measured.map_or_else(|| guessed(level), |errors| errors[level]);
        Ok((0..runs.len()).map(|level| LodLevel { gaussians: count(level), error: error(level) }).collect())
    }

    /// The number of Gaussians of each chunk, all of which belong to one run.
    pub(super) fn chunk_sizes(&self, source: &Source<'_>, cells: &Cells) -> Result<Vec<usize>, Error> {
        let mut runs: Vec<Run> = cells.iter().flatten().flatten().copied().collect();
        runs.sort_unstable_by_key(|run| (run.file, run.offset));
        let mut sizes = vec![0_usize; self.filenames.len()];
        for run in runs {
            let size = &mut sizes[run.file];
            if run.offset != *size {
                let expected = format!("a run that begins at Gaussian {size} of {:.60}", self.filenames[run.file]);
                return Err(source.damaged(0, expected, format!("one at {}", run.offset)));
            }
            *size = size.saturating_add(run.count);
        }
        Ok(sizes)
    }
}

fn bounds(source: &Source<'_>, bound: &Bound) -> Result<Bounds, Error> {
    let bounds = Bounds::from(bound);
    if bounds.min.is_finite() && bounds.max.is_finite() && bounds.min.cmple(bounds.max).all() {
        return Ok(bounds);
    }
    Err(source.damaged(0, "finite bounds of nodes, min up to max", format!("{} to {}", bounds.min, bounds.max)))
}

/// Whether a name is a path into the folder that does not leave it.
pub(in crate::scene3d) fn stays_inside(name: &str) -> bool {
    let inside = Path::new(name).components().all(|part| matches!(part, Component::Normal(_)));
    inside && !name.is_empty() && !name.contains(['\0', ':', '\\'])
}
