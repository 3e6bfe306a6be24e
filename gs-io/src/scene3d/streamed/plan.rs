//! Which Gaussians a streamed SOG has in which chunk, which follows from their number alone.

use std::ops::Range;

use gs_core::Bounds;

use super::meta::{LodMeta, Node, Run, VERSION, WORLD};
use crate::scene3d::sog;

/// Most Gaussians of a cell. Smaller cells fit a view better, but more merges stop at their borders.
pub(super) const CELL: usize = 1 << 13;

/// Most levels of a scene; each has half the Gaussians of the one before.
const LEVELS: usize = 7;

/// Gaussians of a chunk above which no further cell is added.
const CHUNK: usize = 1 << 18;

/// A cell of the tree.
#[derive(Debug)]
pub(super) struct Cell {
    /// Its Gaussians in [`gs_density::spatial_order`].
    pub(super) members: Range<usize>,
    /// Its run in each level.
    pub(super) runs: Vec<Run>,
}

/// The chunks of a scene of any number of Gaussians.
#[derive(Debug)]
pub(super) struct Plan {
    pub(super) cells: Vec<Cell>,
    /// Names of the chunks' folders, in the order of the files in `lod-meta.json`.
    pub(super) chunks: Vec<String>,
}

impl Plan {
    pub(super) fn of(gaussians: usize) -> Self {
        let mut plan = Self { cells: Vec::new(), chunks: Vec::new() };
        plan.add_cells(0..gaussians);
        let smallest = plan.cells.iter().map(|cell| cell.members.len()).min().unwrap_or(1);
        let levels = LEVELS.min(1 + smallest.max(1).ilog2() as usize);
        // The chunk of each level that is not full: its index, and how many Gaussians it has.
        let mut open = vec![None; levels];
        let mut numbers = vec![0; levels];
        for cell in &mut plan.cells {
            for (level, open) in open.iter_mut().enumerate() {
                let (file, offset) = open.unwrap_or_else(|| {
                    plan.chunks.push(format!("{level}_{}", numbers[level]));
                    numbers[level] += 1;
                    (plan.chunks.len() - 1, 0)
                });
                let count = cell.members.len() >> level;
                cell.runs.push(Run { file, offset, count });
                *open = Some((file, offset + count)).filter(|(_, filled)| *filled < CHUNK);
            }
        }
        plan
    }

    fn add_cells(&mut self, range: Range<usize>) {
        match gs_density::halves(&range, CELL) {
            Some(halves) => halves.into_iter().for_each(|half| self.add_cells(half)),
            None => self.cells.push(Cell { members: range, runs: Vec::new() }),
        }
    }

    /// The lengths of the runs of a chunk.
    pub(super) fn runs(&self, file: usize) -> Vec<usize> {
        self.cells.iter().flat_map(|cell| &cell.runs).filter(|run| run.file == file).map(|run| run.count).collect()
    }

    /// The names of all files but `lod-meta.json`.
    pub(super) fn names(&self, sh_degree: u8) -> impl Iterator<Item = String> {
        let names = move |chunk: &String| {
            let chunk = chunk.clone();
            sog::image_names(sh_degree).iter().chain([&sog::META]).map(move |name| format!("{chunk}/{name}"))
        };
        self.chunks.iter().flat_map(names)
    }

    /// The description of the scene, whose cells are `leaves`.
    pub(super) fn meta(&self, leaves: Vec<Node>) -> LodMeta {
        let levels = self.cells.first().map_or(0, |cell| cell.runs.len());
        let count = |level: usize| self.cells.iter().map(|cell| cell.runs[level].count as u64).sum();
        let counts: Vec<u64> = (0..levels).map(count).collect();
        let last = self.cells.last().map_or(0, |cell| cell.members.end);
        LodMeta {
            version: Some(VERSION),
            asset: serde_json::json!({ "generator": concat!("gs ", env!("CARGO_PKG_VERSION")) }),
            count: Some(counts.iter().sum()),
            counts: Some(counts),
            lod_levels: levels,
            lod_errors: true,
            error_unit: Some(WORLD.to_owned()),
            environment: None,
            filenames: self.chunks.iter().map(|chunk| format!("{chunk}/{}", sog::META)).collect(),
            tree: above(0..last, &mut leaves.into_iter()),
        }
    }
}

/// The node of a range, made of the next cells.
fn above(range: Range<usize>, leaves: &mut impl Iterator<Item = Node>) -> Node {
    let Some(halves) = gs_density::halves(&range, CELL) else { return leaves.next().expect("a node for each cell") };
    let [left, right] = halves.map(|half| above(half, leaves));
    Node {
        bound: Bounds::from(&left.bound).union((&right.bound).into()).into(),
        children: Some(vec![Some(left), Some(right)]),
        lods: None,
        errors: None,
    }
}
